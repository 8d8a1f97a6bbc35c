"""The compromise behind config/gains/quiet.yaml: designs around it, judged by plain runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from scipy.optimize import bisect

import ballbot_ros as bb
from ballbot_ros.controllers.design.gain_design import GainDesign
from ballbot_ros.controllers.design.sampled_loop import LoopDelays
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from ballbot_ros.parameters.files import assign_values
from benchmark.tables import print_table

WEIGHTS = (0.034, 0.0067, 0.0016, 0.012, 0.00084)
A_D, A_R, DELAY_MS = 0.975, 0.994, 8.0
"""Those of the quiet gains, see the first line of their file."""

LOW_PASSES = (0.8, 0.9, 0.95, 0.975, 0.985)
VOLTAGE_WEIGHTS = (0.1, 0.3, 3.0, 10.0)

LOWEST_DEG, HIGHEST_DEG, STEP_DEG = 2.0, 12.0, 0.05
"""Pitches at the start between which the largest recoverable one is sought, and how finely."""

FALLEN_DEG = 30.0
QUIETEST = ('stationary', 'hardware_standing')

Values = Mapping[str, object]
"""Parameters by ``node.param``."""


class Design(NamedTuple):
    """A design of the document's structure.

    Attributes
    ----------
    a_d : float
        Low pass of the speed.
    r : float
        Weight of the voltage [1/V²].
    """

    a_d: float
    r: float

    def values(self) -> Values:
        """Return its gains and filters."""
        filters = {f'{CONTROLLER}.a_d': self.a_d, f'{CONTROLLER}.a_r': A_R}
        parameters = ParameterSet()
        assign_values(parameters, filters)
        *k_f, k_i = GainDesign(parameters, LoopDelays(DELAY_MS)).regulator(WEIGHTS, self.r)
        return {**filters, f'{CONTROLLER}.k_f': k_f, f'{CONTROLLER}.k_i': k_i}


def duty_rms(scenario: str, values: Values) -> float:
    """Return the duty [% RMS] of a scenario."""
    return bb.simulate(scenario, parameters=values).metrics['duty_rms_percent']


def recovered_deg(values: Values) -> float:
    """Return the largest pitch at the start [deg] after which the robot of `stationary` stands."""

    def excess(start_deg: float) -> float:
        start = {'plant_sim.start_pitch_x': math.radians(start_deg)}
        run = bb.simulate('stationary', parameters={**values, **start})
        return 1.0 if run.metrics['peak_pitch_deg'] > FALLEN_DEG else -1.0

    return float(bisect(excess, LOWEST_DEG, HIGHEST_DEG, xtol=STEP_DEG))


def missed(values: Values) -> list[str]:
    """Return the shipped scenarios whose expectations are not met."""
    return [name for name in scenario_names() if not bb.simulate(name, parameters=values).passed]


def redesign() -> None:
    """Vary the low pass of the speed and the weight of the voltage around the quiet gains."""
    designs = [Design(a_d, 1.0) for a_d in LOW_PASSES] + [Design(A_D, r) for r in VOLTAGE_WEIGHTS]
    rows = []
    for design in designs:
        values = design.values()
        duties = (f'{duty_rms(name, values):.1f} %' for name in QUIETEST)
        fails = ', '.join(f'`{name}`' for name in missed(values))
        recovered = f'{recovered_deg(values):.1f}°'
        rows.append((f'{design.a_d:g}', f'{design.r:g}', *duties, recovered, fails))
    head = ('`a_d`', '`--r`', *(f'duty, `{name}`' for name in QUIETEST), 'recovers from', 'fails')
    print_table(head, rows)
