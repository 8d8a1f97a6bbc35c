"""Assessment of a recorded run: all metrics, the expectations, and a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ballbot_ros.analysis.metrics import (
    HALF_TICK_S,
    ExpectationVerdict,
    Judgement,
    PropertyJudgement,
    Verdict,
    judge,
    judge_property,
    measure,
    number,
)
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_metrics import RUN_METRICS
from ballbot_ros.analysis.signals import motion_signals
from ballbot_ros.engine.scenario.metrics import lacks_times
from ballbot_ros.engine.scenario.properties import Course
from ballbot_ros.lockstep.run_actions import changes_text
from ballbot_ros.parameters import ControllerParameters, GyroParameters, PlantParameters
from ballbot_ros.robot.world.clearance import NO_WALLS, Walls
from ballbot_ros.robot.world.floor_map import CELL_M, floor_map_of
from ballbot_ros.robot.world.world import World


@dataclass(frozen=True)
class ExpectationResult:
    """An expectation, its measured value and its verdict."""

    judgement: Judgement
    verdict: ExpectationVerdict


class PropertyResult(NamedTuple):
    """A property, its robustness and its verdict."""

    judgement: PropertyJudgement
    verdict: ExpectationVerdict


@dataclass(frozen=True)
class Assessment:
    """A recorded run and everything computed from it.

    The metrics are those of :data:`~ballbot_ros.engine.scenario.metrics.METRICS`, then those of
    :data:`~ballbot_ros.analysis.run_metrics.RUN_METRICS`; NaN if the data are missing. `reason`
    says why the run did not pass; it is empty if it passed.
    """

    run: RunData
    metrics: dict[str, float]
    expectations: tuple[ExpectationResult, ...]
    properties: tuple[PropertyResult, ...]
    outcome: Verdict
    reason: str

    def as_json(self) -> dict[str, object]:
        """Return metrics, verdicts and facts about the file; missing numbers are None."""
        run = self.run
        return {
            'recording': str(run.path),
            'run': run.number,
            'runs': run.count,
            'outcome': self.outcome.value,
            'reason': self.reason,
            'real_robot': run.is_real,
            'complete': run.complete,
            'damage': run.damage,
            'notices': list(run.notices),
            'ticks': None if run.is_real else len(run.trajectory.time),
            'duration_s': run.end,
            'seed': run.attached.parameters.of(GyroParameters).seed
            if run.attached.has_parameters and not run.is_real
            else None,
            'versions': run.attached.versions,
            'pushes': [push.as_json() for push in run.pushes],
            'parameter_changes': [each.as_json() for each in run.parameter_changes],
            'metrics': {name: number(value) for name, value in self.metrics.items()},
            'expectations': [
                {**each.judgement.as_json(), 'verdict': each.verdict.value}
                for each in self.expectations
            ],
            'properties': [
                {**each.judgement.as_json(), 'verdict': each.verdict.value}
                for each in self.properties
            ],
            'topics': [
                {
                    'topic': each.topic,
                    'type': each.type_name,
                    'messages': each.count,
                    'rate_hz': number(each.rate_hz),
                    'longest_gap_s': each.gap_ns * 1e-9,
                    'age_mean_ms': number(each.age_ms[0]),
                    'age_max_ms': number(each.age_ms[1]),
                }
                for each in run.topic_statistics
            ],
        }


def assess(run: RunData) -> Assessment:
    """Measure a run and judge it by its attached scenario."""
    walls = _walls(run)
    metrics = {**measure(run.trajectory, run.plant, walls), **RUN_METRICS.measure(run)}
    scenario = run.attached.scenario
    expectations = scenario.expectations if scenario else ()
    judgements = judge(expectations, run.trajectory, run.plant, walls)
    judged = tuple(ExpectationResult(each, _verdict(run, each)) for each in judgements)
    properties = judge_recorded_properties(run, walls)
    decided = tuple(PropertyResult(each, _verdict(run, each)) for each in properties)
    outcome, reason = _outcome(run, (*judged, *decided))
    if run.outside_changes and outcome is Verdict.PASSED:
        outcome = Verdict.CHANGED
    reason = '; '.join(filter(None, (reason, changes_text(run.outside_changes))))
    run = replace(run, decisions=tuple(mark for each in properties for mark in each.marks))
    return Assessment(run, metrics, judged, decided, outcome, reason)


def judge_recorded_properties(run: RunData, walls: Walls | None = None) -> list[PropertyJudgement]:
    """Evaluate the properties of a run's scenario; `walls` are those of its map, if known."""
    scenario = run.attached.scenario
    if not scenario or not scenario.properties or not run.intact:
        return []
    pushes = sorted((each.start, each.end) for each in run.pushes)
    mode = run.attached.parameters.of(ControllerParameters).mode
    signals = motion_signals(run.trajectory, _walls(run) if walls is None else walls, lambda: run)
    course = Course({**scenario.events, 'push': pushes}, mode)
    return [judge_property(each, signals, run.plant, course) for each in scenario.properties]


def _walls(run: RunData) -> Walls:
    """Return the walls of the recorded map; none for an unsupported map."""
    grid = run.grid
    if grid is None or not np.isclose(grid.resolution, CELL_M):
        return NO_WALLS
    return World(floor_map_of(grid), run.plant.body_depth, run.plant.body_width).walls


def shown_metrics(assessment: Assessment) -> dict[str, float]:
    """Return the metrics without times in states that never occurred, and settling of a drive.

    Those of tasks that take no time are left out, too, and those that a real robot cannot have.
    """
    without = {'settling_time_s'} if assessment.run.is_driven else set()
    return {
        name: value
        for name, value in assessment.metrics.items()
        if name not in without
        and not (assessment.run.is_real and math.isnan(value))
        and not (name.startswith('time_in_') and value == 0.0)
        and not lacks_times(name, value)
    }


def _verdict(run: RunData, judgement: Judgement | PropertyJudgement) -> ExpectationVerdict:
    if isinstance(judgement, PropertyJudgement):
        is_known = run.complete and not judgement.lack
    else:
        expectation = judgement.expectation
        within = run.intact and expectation.end < run.end + HALF_TICK_S
        # A settling time of NaN means "never settles"; NaN of any other metric means missing data.
        has_value = not math.isnan(judgement.value) or expectation.metric == 'settling_time_s'
        is_known = has_value and (run.complete or within)
    if not is_known:
        return ExpectationVerdict.NOT_JUDGED
    return ExpectationVerdict.MET if judgement.holds else ExpectationVerdict.NOT_MET


def _outcome(
    run: RunData, judged: tuple[ExpectationResult | PropertyResult, ...]
) -> tuple[Verdict, str]:
    if failure := _failure(run):
        return Verdict.FAILED, failure
    missed = [each.judgement for each in judged if each.verdict is ExpectationVerdict.NOT_MET]
    if missed:
        return Verdict.NOT_MET, ', '.join(map(str, missed))
    if not run.complete:
        return Verdict.INCOMPLETE, _lack(run)
    if run.is_real:
        return Verdict.NOT_JUDGED, 'the true motion of a real robot is unknown'
    if run.attached.scenario is None:
        return Verdict.NOT_JUDGED, 'no scenario is attached'
    unknown = [
        each.judgement.of.name
        if isinstance(each, PropertyResult)
        else each.judgement.expectation.metric
        for each in judged
        if each.verdict is ExpectationVerdict.NOT_JUDGED
    ]
    if unknown:
        return Verdict.NOT_JUDGED, f'{", ".join(unknown)} cannot be computed from this recording'
    return Verdict.PASSED, ''


def _lack(run: RunData) -> str:
    if run.damage:
        return run.damage
    if run.missing_ticks:
        return f'{run.missing_ticks} ticks are missing'
    if not run.reached_end:
        duration = run.attached.parameters.of(PlantParameters).duration
        return f'it ends at {run.end:.3f} s of {duration:g} s'
    return 'topics are missing'


def _failure(run: RunData) -> str:
    """Return the last error that a node reported, or the recorded reason; empty for none."""
    errors = [f'{each.node}: {each.message}' for _, each in run.statuses if each.level == 2]
    return errors[-1] if errors else run.failure
