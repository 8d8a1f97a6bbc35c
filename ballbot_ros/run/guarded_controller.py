"""A controller in a process of its own, for runs that would hang with it.

In separate processes the plant notices a controller that does not return. With all nodes in one
process, or without nodes, the plant would hang, too. There a child process runs the controller, and
the plant's process notices its silence.
"""

from __future__ import annotations

import faulthandler
import math
import os
import re
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any, NamedTuple

from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.brick.schedule import Schedule
from ballbot_ros.codegen.implementation import Implementation, implementation_for
from ballbot_ros.controllers.controller_program import TickTimes
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.interface import Estimates, OperatingState, PlaneEstimates
from ballbot_ros.controllers.loading import LoadedController, shown_line
from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.processes import ProcessSilence, end_with_parent
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.run.child_process import start_child

_POLL_S = 0.05
_STACK_S = 0.5
_FRAME = re.compile(r'File "(.+)", line (\d+)')


class _Answer(NamedTuple):
    """The results of a tick."""

    outputs: DeviceOutputs
    x: PlaneEstimates
    y: PlaneEstimates
    operating_state: OperatingState
    times: TickTimes


def guarded_implementation(
    parameters: ControllerParameters, plant: PlantParameters, composed: LoadedController | None
) -> Implementation:
    """Return the implementation that the parameters select, guarded if it is foreign code.

    Parameters
    ----------
    composed : LoadedController or None
        The controller for which the run was composed.

    Raises
    ------
    BallbotError
        As for :func:`~ballbot_ros.codegen.implementation.implementation_for`; also if the code has
        changed.
    """
    implementation = implementation_for(parameters)
    require_same_code(implementation, composed.code.source.sha256 if composed else '')
    loaded = implementation.loaded
    if loaded is None or loaded.code.is_ours:
        return implementation
    return replace(
        implementation,
        make=lambda: GuardedProgram(parameters, loaded, plant, implementation.times),
    )


def require_same_code(implementation: Implementation, sha256: str) -> None:
    """Raise ControllerError unless the code is that for which the run was composed."""
    loaded = implementation.loaded
    if loaded and loaded.code.source.sha256 != sha256:
        raise ControllerError(f'{loaded.code.public} has changed since the run was composed')


class GuardedProgram:
    """A controller's program in a child process, which starts at the first tick.

    The two exchange pickled objects over a socket: the arguments of :meth:`run` or :meth:`retune`,
    and an answer, or the text of an error.

    Parameters
    ----------
    plant : PlantParameters
        Its timeouts are those of the controller.
    times : TickTimes
        Receives how long the ticks take.
    """

    def __init__(
        self,
        parameters: ControllerParameters,
        loaded: LoadedController,
        plant: PlantParameters,
        times: TickTimes,
    ) -> None:
        self.x: PlaneEstimates = Estimates()
        self.y: PlaneEstimates = Estimates()
        self.operating_state = OperatingState.BALANCE
        self._parameters, self._loaded, self._plant = parameters, loaded, plant
        self._times = times
        times.reset()
        self._schedule = Schedule(loaded.tasks)
        self._child: _Child | None = None

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over parameters that change during a run, from the next tick on."""
        self._exchange(parameters)

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""
        return self.run(self._schedule.due(elapsed_ms), systick_ms, inputs)

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick.

        Raises
        ------
        ControllerError
            If the controller fails, or does not return.
        """
        answer: _Answer = self._exchange((tasks, systick_ms, tuple(inputs)))
        self.x, self.y, self.operating_state = answer.x, answer.y, answer.operating_state
        self._times.copy(answer.times)
        return answer.outputs

    def _exchange(self, request: object) -> Any:
        timeout_s = self._plant.timeout
        if self._child is None:
            self._child = _Child(self._parameters, self._loaded)
            timeout_s = self._plant.startup_timeout
        if self._plant.on_timeout != 'end':
            timeout_s = math.inf
        return self._child.exchange(request, timeout_s)


class _Child:
    """The child process; it ends with this object."""

    def __init__(self, parameters: ControllerParameters, loaded: LoadedController) -> None:
        self._loaded = loaded
        # In memory: where the controller is, if it does not return.
        stack = os.fdopen(os.memfd_create('stack'), 'rb', buffering=0)
        # Ctrl-C is for the run, which ends the controller.
        self._process, self._connection = start_child(__name__, [stack.fileno()])
        self._stack = stack
        self._end = weakref.finalize(self, _end, self._process, self._connection, stack)
        self._connection.send((sys.path, parameters, loaded.code.source.sha256))

    def exchange(self, request: object, timeout_s: float) -> Any:
        """Return the answer; ControllerError if it is an error, or none within `timeout_s` [s]."""
        try:
            self._connection.send(request)
            silence = ProcessSilence(self._process.pid)
            while not self._connection.poll(_POLL_S):
                if silence.measure_s() > timeout_s:
                    raise ControllerError(f'no answer within {timeout_s:g} s{self._where()}')
            answer = self._connection.recv()
            if isinstance(answer, str):
                raise ControllerError(answer)
            return answer
        except (OSError, EOFError):
            status = self._process.wait()
            end = f'was killed by {signal.Signals(-status).name}' if status < 0 else 'ended'
            raise ControllerError(f'{self._loaded.code.public}: its process {end}') from None
        except ControllerError:
            self._end()
            raise

    def _where(self) -> str:
        """Return the line at which the controller is; '' if it is unknown."""
        self._process.send_signal(signal.SIGUSR1)
        silence = ProcessSilence(self._process.pid)
        text = ''
        while not text.endswith('\n\n') and silence.measure_s() < _STACK_S:
            time.sleep(_POLL_S)
            text = os.pread(self._stack.fileno(), 2**16, 0).decode(errors='replace')
        for path, line in _FRAME.findall(text):
            if self._loaded.code.has(Path(path)):
                return f': {shown_line(path, int(line))} does not return'
        return ''


def _end(process: subprocess.Popen[bytes], connection: Connection, stack: IO[bytes]) -> None:
    connection.close()
    stack.close()
    process.kill()
    process.wait()


def main() -> None:
    """Run the controller, until the parent closes the connection."""
    if not end_with_parent():
        return
    connection = Connection(int(sys.argv[1]))
    faulthandler.register(signal.SIGUSR1, file=int(sys.argv[2]), all_threads=False)
    with suppress(EOFError, OSError):  # the run has ended
        sys.path[:], parameters, sha256 = connection.recv()
        try:
            _serve(connection, implementation_for(parameters), sha256)
        except BallbotError as error:
            connection.send(one_line(error))


def _serve(connection: Connection, implementation: Implementation, sha256: str) -> None:
    require_same_code(implementation, sha256)
    program = implementation.make()
    while True:
        request = connection.recv()
        if isinstance(request, ControllerParameters):
            program.retune(request)
            connection.send(None)
            continue
        tasks, systick_ms, inputs = request
        outputs = program.run(tasks, systick_ms, DeviceInputs._make(inputs))
        connection.send(
            _Answer(outputs, program.x, program.y, program.operating_state, implementation.times)
        )
