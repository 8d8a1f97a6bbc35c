"""The package as a library: simulate runs, open recordings, get the linear model.

Its functions are those of the package itself: ``import ballbot_ros as bb``.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ballbot_ros.analysis.run import Run
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.controllers.class_reference import reference_to, require_unchanged
from ballbot_ros.controllers.controller import Controller
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.errors import BallbotError, short_repr
from ballbot_ros.files import temporary_folder
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters import CONTROLLER, PLANT, ParameterError, ParameterSet, PlantParameters
from ballbot_ros.parameters.controller import MODEL, USER
from ballbot_ros.parameters.files import (
    Parameters,
    assign_values,
    plain_value,
    plain_values,
    read_parameter_file,
)
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.robot.plant.model import PhysicalParameters
from ballbot_ros.run.branch import branch_spec, prove, read_past
from ballbot_ros.run.future import RECORDED, given_future
from ballbot_ros.run.observer import LogObserver
from ballbot_ros.run.offline import run_offline
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

if TYPE_CHECKING:
    import control

_PHYSICAL = frozenset(f'{PLANT}.{each.name}' for each in fields(PhysicalParameters))
_GAINS = frozenset(f'{CONTROLLER}.{name}' for name in ('k_f', 'k_i', 'pwm_gain'))


def simulate(
    scenario: str | os.PathLike[str] = 'stationary',
    controller: str | type[Controller[Any]] | Controller[Any] | None = None,
    *,
    seed: int | None = None,
    profile: str | None = None,
    parameters: Parameters | None = None,
) -> Run:
    """Run a scenario in this process, without ROS.

    The motor duties are those of the node graph, bit for bit. The random numbers depend on the seed
    only, so the same arguments give the same run.

    Parameters
    ----------
    scenario : str or path-like
        Name of a shipped scenario, or a scenario file.
    controller : str, class, Controller or None
        None for the scenario's, which is the document's control program unless it sets another. A
        string is a value of the option ``--controller``: ``'lqg'``, ``'FILE.py:Class'``. From an
        instance the run takes class, parameters and design model, and makes its own instance. The
        class may be defined in a notebook.
    seed : int or None
        Seed of the device noise and jitter; None for that of `parameters` or scenario.
    profile : str or None
        Device profile, such as ``'hardware'``, or a parameter file; None for the scenario's.
    parameters : mapping or path-like or None
        Values that override the scenario and the instance of a controller: by ``node.param``, such
        as ``{'plant_sim.duration': 60}`` or ``{'controller.user.kp': 3}``, or a parameter file.

    Returns
    -------
    Run
        Also if the robot falls or the controller fails: see `verdict` and `reason`. A failure is
        logged as a warning, too.

    Raises
    ------
    BallbotError
        If an argument is not valid, or the run ends before its first tick; the message is one line.
    KeyboardInterrupt
        If it is interrupted; the run is lost.
    """
    with temporary_folder() as name:
        folder = Path(name)
        reference, own_values = _reference_and_values(controller)
        file, values = _file_and_values(parameters)
        options = RunOptions(
            processes=Processes.NONE,
            profile=profile,
            values={**own_values, **values},
            parameter_file=file,
            seed=plain_value(seed),
            controller=reference,
        )
        spec = RunSpec.of_scenario(os.fspath(scenario), options)
        path = folder / f'{spec.name}.mcap'
        result = run_offline(spec, path, LogObserver(), collects_data=True)
        run = Run(result.data or read_run(path), path.read_bytes()) if result.ticks else None
    if result.outcome is Outcome.STOPPED:
        signal.raise_signal(result.failure_status - 128)  # now with its usual effect
    if run is None:
        raise BallbotError(result.failure)
    return run


def branch(
    run: Run | str | os.PathLike[str],
    at: float,
    *,
    pushes: Mapping[str, object] | Sequence[Mapping[str, object]] = (),
    faults: str = '',
    parameters: Mapping[str, object] | None = None,
    sticks: tuple[int, int] | str = RECORDED,
    controller: str | None = None,
    number: int | None = None,
) -> Run:
    """Run a run again up to a moment, and then change something; in this process, without ROS.

    Up to that moment, the run is proven to be the same, message by message. What happened later
    (sticks, pushes, changes of parameters) happens again, unless it is changed.

    Parameters
    ----------
    run : Run or path-like
        The earlier run, or its recording.
    at : float
        When the branch begins, from the start of the run [s].
    pushes : mapping or sequence of mapping
        Further pushes, as in a scenario: ``{'force': 0.8, 'direction': 'left'}``. Without `time`
        and `duration`, they begin at the branch and last 0.1 s.
    faults : str
        Faults, such as ``'gyro_x stuck duration=2; gyro_y off'``.
    parameters : mapping of str to object
        New values of gains and thresholds of the controller, such as ``{'controller.k_i': -0.01}``.
    sticks : tuple of int or str
        The sticks (vertical, horizontal) from then on, or ``'recorded'``.
    controller : str or None
        Another controller that takes over, as in the option ``--controller``. It has run along from
        the start.
    number : int or None
        Number of the run in a recording of several, from 1.

    Returns
    -------
    Run
        The branch; its attribute `earlier` is the earlier run, which its figure shows, too.

    Raises
    ------
    BallbotError
        If an argument is not valid, or the run can't be branched; the message is one line.
    """
    with temporary_folder() as name:
        folder = Path(name)
        if isinstance(run, Run):
            path = run.save(folder / f'{run.name}.mcap')
        else:
            path = Path(run).absolute()
        given = [pushes] if isinstance(pushes, Mapping) else pushes
        future = given_future(
            float(at),
            pushes=map(plain_values, given),
            faults=faults,
            values=plain_values(parameters or {}),
            sticks=sticks,
            controller=controller,
            names=('pushes', 'faults', 'parameters', 'sticks'),
        )
        with open_recording(path) as reader:
            past = read_past(reader, number, folder)
            spec = branch_spec(past, future, folder, output=folder)
            recording = folder / f'{spec.name}.mcap'
            result = run_offline(spec, recording, LogObserver(), collects_data=True)
            proof = prove(past, recording, future.at) if result.ticks else None
        if result.outcome is Outcome.STOPPED:
            signal.raise_signal(result.failure_status - 128)
        if proof is None or proof.problem:
            raise BallbotError(proof.problem if proof else result.failure)
        earlier = run if isinstance(run, Run) else open(path, number)
        return Run(result.data or read_run(recording), recording.read_bytes(), earlier)


def open(path: str | os.PathLike[str], number: int | None = None) -> Run:  # noqa: A001
    """Open the recording of a run, from the node graph or from `Run.save`.

    If the file is damaged, the part before the damage is read.

    Parameters
    ----------
    path : str or path-like
        The recording.
    number : int or None
        Number of the run in a recording of several, from 1; None for the last one.

    Raises
    ------
    RecordingError
        If it is not a recording of a ballbot, or has no such run.
    """
    file = Path(path).absolute()
    return Run(read_run(file, number), file)


def linear_model(parameters: Parameters | None = None) -> control.StateSpace:
    """Return the linear model of one plane (3.24).

    Parameters
    ----------
    parameters : mapping or path-like or None
        Physical values of ``plant_sim`` other than the document's, by name as in :func:`simulate`,
        or a parameter file.

    Returns
    -------
    control.StateSpace
        Input: the motor voltage `v` [V]. States and outputs: the ball angle `theta` and the body
        pitch `psi` [rad], and their rates `theta_dot` and `psi_dot` [rad/s].

    Raises
    ------
    BallbotError
        If a parameter is not valid, or is none of the model.
    """
    # Its import takes two seconds.
    from ballbot_ros.controllers.design.linear_model import plane_model

    plant = _parameter_set(parameters, _PHYSICAL).of(PlantParameters)
    return plane_model(PhysicalParameters.from_parameters(plant))


def loop(parameters: Parameters | None = None) -> control.StateSpace:
    """Return the loop of one plane, opened at the motor voltage, for margins and Bode diagrams.

    It is the ideal loop of section 4.2: state feedback in continuous time with the document's
    structure, ``k_f`` on the states of :func:`linear_model` and ``k_i`` on the integral of `theta`,
    both times ``pwm_gain``. The loop that runs is :func:`sampled_loop`, whose margins are smaller.

    Parameters
    ----------
    parameters : mapping or path-like or None
        Physical values of ``plant_sim``, and ``controller.k_f``, ``controller.k_i`` and
        ``controller.pwm_gain``, other than the document's; or a parameter file.

    Returns
    -------
    control.StateSpace
        From the motor voltage `v` [V] to the voltage `v_fb` [V] that the feedback subtracts: the
        closed loop is ``control.feedback(loop)``.

    Raises
    ------
    BallbotError
        If a parameter is not valid, or is none of the loop.
    """
    from ballbot_ros.controllers.design.linear_model import ideal_loop

    return ideal_loop(_parameter_set(parameters, _PHYSICAL | _GAINS))


def sampled_loop(parameters: Parameters | None = None) -> control.StateSpace:
    """Return the loop of one plane as it runs, opened at the duty.

    A system from tick to tick with the document's program: duties held for a tick, samples of gyro
    and encoder, the filters ``a_d`` and ``a_gd``, the integrals as the program computes them, and
    all dead times; one with jitter counts with its mean. It does not round or saturate.

    Parameters
    ----------
    parameters : mapping or path-like or None
        Values other than the defaults, or a parameter file: physical values, battery and dead time
        of ``plant_sim``, dead times of ``gyro_driver`` and ``encoder_driver``, gains and filters of
        ``controller``.

    Returns
    -------
    control.StateSpace
        From the applied duty [%] to the duty `duty_fb` [%] that the feedback subtracts, every 4 ms:
        the closed loop is ``control.feedback(sampled_loop)``.

    Raises
    ------
    BallbotError
        If a parameter is not valid, or is none of the loop.
    """
    from ballbot_ros.controllers.design.sampled_loop import PARAMETERS, SampledLoop

    return SampledLoop(_parameter_set(parameters, PARAMETERS)).open_loop()


def _reference_and_values(
    controller: str | type[Controller[Any]] | Controller[Any] | None,
) -> tuple[str | LoadedController | None, dict[str, object]]:
    """Return what selects a controller, and the values of the parameters of an instance."""
    if controller is None or isinstance(controller, str):
        return controller, {}
    if isinstance(controller, type) and issubclass(controller, Controller):
        return reference_to(controller), {}
    if not isinstance(controller, Controller):
        raise BallbotError(
            f'controller: {short_repr(controller)} is not a name, a subclass of '
            f'{Controller.__module__.rpartition(".")[0]}.{Controller.__name__}, or its instance'
        )
    reference = reference_to(type(controller))
    require_unchanged(controller)
    values = {
        f'{CONTROLLER}.{prefix}{each.name}': getattr(own, each.name)
        for prefix, own in ((USER, controller.parameters), (MODEL, controller.model))
        for each in fields(own)
    }
    return reference, values


def _file_and_values(parameters: Parameters | None) -> tuple[Path | None, dict[str, object]]:
    """Return the file or the values that parameters are given by."""
    if parameters is None:
        return None, {}
    if isinstance(parameters, Mapping):
        return None, plain_values(parameters)
    if not isinstance(parameters, str | os.PathLike):
        raise BallbotError(f'parameters: {short_repr(parameters)} is neither a mapping nor a path')
    return Path(parameters), {}


def _parameter_set(parameters: Parameters | None, allowed: Iterable[str]) -> ParameterSet:
    """Return the parameters of a model; refuse values, but not a file's, that it does not have."""
    file, values = _file_and_values(parameters)
    found = read_parameter_file(file) if file else ParameterSet()
    assign_values(found, values)
    if others := sorted(values.keys() - set(allowed)):
        raise ParameterError(f'{others[0]} has no effect here; only {", ".join(sorted(allowed))}')
    return found
