"""Replay of all runs of a recording, and comparison with the recorded messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from ballbot_ros.analysis.message_comparison import Divergence, MessageComparator, MessageDifference
from ballbot_ros.analysis.recorded_controller import (
    SUCCESSOR,
    ControllerIdentity,
    ReplayedController,
    Successor,
    choose_controller,
    decode_controller,
    find_recorded,
    identity_of,
    load_attached,
)
from ballbot_ros.analysis.recorded_runs import RecordedRun, is_real_robot
from ballbot_ros.analysis.replay import (
    ReplayedTick,
    RunToRepeat,
    compare_events,
    read_inputs,
    replay_controller,
    replay_run,
)
from ballbot_ros.controllers.codegen.implementation import (
    missing_tool_for,
    require_implementation,
    successor_of,
    with_successor,
)
from ballbot_ros.controllers.controller_program import own_rows
from ballbot_ros.controllers.loading import LoadedController, public_reference
from ballbot_ros.engine.compiled_loop import compile_for_the_next_time
from ballbot_ros.engine.law_runs import has_law
from ballbot_ros.engine.trajectory import Engine
from ballbot_ros.errors import BallbotError, ControllerError, RecordingError, printable
from ballbot_ros.files import OUR_PACKAGE, write_temporary
from ballbot_ros.lockstep.participants import Participant
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    DRIVERS,
    PLANT,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import assign, read_parameter_file
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS, TICK_S
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, INPUT_READERS, AnyDeviceMessages
from ballbot_ros.recording.messages.topics import (
    BRICK_TASKS,
    CONTROLLER_TOPICS,
    PARTICIPANTS,
    REPLAYED_TOPICS,
    Topic,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import CONTROLLER_INFO, PARAMETERS
from ballbot_ros.robot.world.floor_map import is_file_name

CONTEXT_TICKS = 2
"""Ticks shown before and after a difference."""

MAX_MISSING = 900_000
"""Largest number of ticks without a duty, an hour: more would take very long to simulate."""

END_OF_TIME_NS = 2**31 * SECOND_NS
"""Smallest stamp that a message can't have [ns]."""

ReportTime = Callable[[float], None]
"""Callback that receives the sim time replayed so far [s]."""


@dataclass(frozen=True)
class ReplayResult:
    """Result of a comparison of the ``controller`` or the ``robot``: the part that was run again.

    It has the numbers of compared ticks and messages, and the first difference, if any. `context`
    has the ticks around a difference of the robot: recorded inputs, and the controller's outputs.
    The engine is the interpreter if it made any tick.
    """

    subject: str
    ticks: int
    messages: int
    difference: MessageDifference | None
    context: Sequence[ReplayedTick] = ()
    engine: Engine = Engine.INTERPRETED


class RecordingReplay:
    """Replays the runs of a recording, whose attachments go to the folder `scratch`.

    The implementation of the controller is `controller`, or the recorded one. The code of a
    controller other than the document's is the user's own copy, or, if it is to be trusted, the
    attached one. It raises RecordingError if there is nothing to replay, or the parameters of a run
    are unknown.

    Attributes
    ----------
    recording, announced : RobotRecording, AnnouncedParameters
        The recording, and what the participants of its runs announced.
    runs : list of RunToRepeat
        The runs that have a tick with a duty.
    controllers : list of ReplayedController
        One for each of these runs.
    duration : float
        Sim time of these runs [s].
    controller_in_robot : ReplayResult or None
        Result of the controller that follows from that of the robot; None if it has to be replayed.
    """

    def __init__(
        self,
        reader: RecordingReader,
        scratch: Path,
        controller: str | None = None,
        *,
        trust_attached_code: bool = False,
    ) -> None:
        if is_real_robot(reader):
            raise RecordingError(
                f'{reader.path}: a recording of a real robot cannot be run again: it lacks the '
                'samples of most ticks, and the true state'
            )
        attached = _attached_parameters(reader, scratch)
        announced = any(name.endswith(f'/{PARTICIPANTS.name}') for name in reader.topics())
        if attached is None and not announced:
            raise RecordingError(_nothing_to_replay_by(reader.path))
        recorded = read_inputs(reader)
        self.recording, self.announced = recorded.recording, recorded.announced
        self._begun = [
            RunToRepeat(self.recording, inputs, self._parameters(inputs.run, attached, scratch))
            for inputs in recorded.runs
            if inputs.ticks or recorded.has_begun(inputs.run)
        ]
        self.runs = [job for job in self._begun if job.inputs.ticks]
        if not self.runs:
            raise RecordingError(f'{reader.path}: nothing to replay: no tick has a duty')
        for inputs in recorded.runs:
            start_ns, last_ns = inputs.run.start_ns, inputs.last_ns
            missing = inputs.ticks - len(inputs.duties)
            if start_ns % TICK_NS or last_ns >= END_OF_TIME_NS or missing > MAX_MISSING:
                raise RecordingError(
                    f'{reader.path}: cannot replay from {start_ns} ns to {last_ns} ns: these are '
                    f'not the stamps of a run, or more than {MAX_MISSING} ticks have no duty'
                )
        if controller in DOCUMENTS_PROGRAM:
            require_implementation(controller)
        self.controller_in_robot: ReplayResult | None = None
        self._are_functions = True
        self._scratch, self._trusts_code = scratch, trust_attached_code
        chosen = {id(job): self._choose(job, controller) for job in self._begun}
        self.controllers = [chosen[id(job)] for job in self.runs]
        self.duration = sum(job.inputs.ticks for job in self.runs) * TICK_NS / SECOND_NS

    def _parameters(
        self, run: RecordedRun, attached: ParameterSet | None, scratch: Path
    ) -> ParameterSet:
        """Return the parameters of a run, with its map in the scratch folder."""
        reader = self.recording.reader
        if attached is None and not self.announced.has_parameters(run.name):
            raise RecordingError(_nothing_to_replay_by(reader.path))
        files = reader.attachments()
        parameters = self.announced.of(run.name, attached or ParameterSet(), files)
        name = parameters.of(PlantParameters).map
        if is_file_name(name):
            if name not in files:
                raise RecordingError(f'{reader.path}: the map {name!r} is not attached')
            image = scratch / f'map{Path(name).suffix}'
            write_temporary(image, files[name].data)
            parameters.set(PLANT, 'map', str(image))
        return parameters

    def _choose(self, job: RunToRepeat, requested: str | None) -> ReplayedController:
        """Choose the controllers of a run, and set them in the run's parameters."""
        after = successor_of(job.parameters.of(ControllerParameters))
        if after is None:
            return self._choose_first(job, requested)
        is_portable, reference = True, after[1].implementation
        if reference not in DOCUMENTS_PROGRAM:
            second = self._choose_successor(job, requested)
            is_portable = second.cls.portable
            if requested and requested.endswith(f':{second.code.class_name}'):
                requested = None
        first = self._choose_first(job, requested)
        return replace(
            first,
            successor=Successor(public_reference(reference), after[0]),
            is_portable=first.is_portable and is_portable,
        )

    def _choose_successor(self, job: RunToRepeat, requested: str | None) -> LoadedController:
        """Set the controller that takes over during a run, and return it."""
        reader = self.recording.reader
        files = reader.attachments()
        identity = decode_controller(files, SUCCESSOR)
        if identity is None:
            raise RecordingError(f'{reader.path}: {SUCCESSOR}.yaml is missing or cannot be read')
        if self._trusts_code:
            loaded = load_attached(identity, reader.path, files, self._scratch, SUCCESSOR)
        else:
            is_its = requested and requested.endswith(f':{identity.class_name}')
            loaded = find_recorded(identity, reader.path, requested if is_its else None)
        self._are_functions &= loaded.code.is_ours and has_law(loaded.cls)
        changes = job.parameters.of(ControllerParameters).changes
        changes = with_successor(changes, lambda recorded: loaded.code.reference)
        job.parameters.set(CONTROLLER, 'changes', changes)
        return loaded

    def _choose_first(self, job: RunToRepeat, requested: str | None) -> ReplayedController:
        participant = self.announced.participant(job.inputs.run.name, CONTROLLER)
        if identity := self._identity(job, participant):
            return self._choose_class(job, identity, requested)
        if ':' in job.implementation and not (participant and participant.is_foreign):
            raise RecordingError(
                f'{self.recording.reader.path}: cannot replay the controller '
                f'{printable(job.implementation)}: {CONTROLLER_INFO} is missing or cannot be read'
            )
        if requested is not None and requested not in DOCUMENTS_PROGRAM:
            raise ControllerError(
                f'--controller {requested}: {self.recording.reader.path} can be replayed only by '
                f'{", ".join(DOCUMENTS_PROGRAM)}'
            )
        chosen = choose_controller(participant, job.implementation, requested, missing_tool_for)
        job.parameters.set(CONTROLLER, 'implementation', chosen.replayed)
        job.parameters.drop_own(chosen.replayed)
        return chosen

    def _identity(
        self, job: RunToRepeat, participant: Participant | None
    ) -> ControllerIdentity | None:
        """Return what identifies a controller other than the document's; None for any other."""
        if job.implementation in DOCUMENTS_PROGRAM or (participant and participant.is_foreign):
            return None
        announced = participant.parameters if participant else {}
        attached = decode_controller(self.recording.reader.attachments())
        return identity_of(job.implementation, announced, attached)

    def _choose_class(
        self, job: RunToRepeat, identity: ControllerIdentity, requested: str | None
    ) -> ReplayedController:
        reader = self.recording.reader
        if requested in DOCUMENTS_PROGRAM:
            raise ControllerError(
                f'--controller {requested}: {reader.path} can be replayed only by {identity}'
            )
        if self._trusts_code and not identity.is_of_main:  # which is attached only to be read
            files = reader.attachments()
            loaded = load_attached(identity, reader.path, files, self._scratch)
        else:
            loaded = find_recorded(identity, reader.path, requested)
        self._are_functions &= loaded.code.is_ours and has_law(loaded.cls)
        job.parameters.set(CONTROLLER, 'implementation', loaded.code.reference)
        job.parameters.declare_own(loaded.cls.__name__, own_rows(loaded))
        reference = identity.reference
        replayed = public_reference(loaded.code.reference) if identity.is_of_main else reference
        return ReplayedController(reference, replayed, is_portable=loaded.cls.portable)

    def _foreign_drivers(self, job: RunToRepeat) -> list[Participant]:
        """Return the drivers of a run that are nodes of other packages."""
        found = self.announced.foreign(job.inputs.run.name)
        return [each for role, each in found.items() if role in DRIVERS]

    @property
    def reasons(self) -> list[str]:
        """Why a run is not replayed with the programs that were recorded."""
        drivers = [each for job in self._begun for each in self._foreign_drivers(job)]
        return [
            *dict.fromkeys(each.reason for each in self.controllers if each.reason),
            *dict.fromkeys(
                f'its {each.role} {each.implementation!r} is not part of {OUR_PACKAGE}: the '
                'recorded samples replay it'
                for each in drivers
            ),
        ]

    def replay_controller(self, update: ReportTime) -> ReplayResult:
        """Run the controller on the recorded samples; compare its messages."""
        comparator = self._comparator(CONTROLLER_TOPICS)
        ticks = chain.from_iterable(replay_controller(job, comparator) for job in self.runs)
        engines = (Engine.INTERPRETED for _ in ticks)
        return self._compare('controller', self.runs, comparator, engines, update)

    def replay_robot(self, update: ReportTime) -> ReplayResult:
        """Run the whole robot; compare all messages.

        If they are identical, `controller_in_robot` may have the result of the controller, too.
        """
        foreign = {each.role for job in self._begun for each in self._foreign_drivers(job)}
        ours = (topic for topic in REPLAYED_TOPICS if topic.publisher not in foreign)
        comparator = self._comparator(ours)
        engines = (
            engine
            for job in self._begun
            for engine in replay_run(job, comparator, self._recorded_devices(job))
        )
        result = self._compare('robot', self._begun, comparator, engines, update)
        compile_for_the_next_time()
        if result.difference is None:
            if not foreign and self._robot_shows_controller():
                messages = comparator.compared(CONTROLLER_TOPICS)
                self.controller_in_robot = replace(result, subject='controller', messages=messages)
            return result
        # Show the last run that had begun by then; it may have ended before the difference.
        moment = result.difference.epoch, result.difference.stamp_ns
        starts = ((job.inputs.run, job) for job in self._begun)
        begun = [job for run, job in starts if (run.epoch, run.start_ns) <= moment]
        if not begun:
            return result
        return replace(result, context=self._context(begun[-1], result.difference.stamp_ns))

    def _robot_shows_controller(self) -> bool:
        """Return whether an identical robot implies an identical controller.

        The samples that the controller gets in it are those recorded. The document's program, or a
        law of this package, depends on nothing else.
        """
        return (
            self._are_functions
            and self.recording.reader.complete
            and len(self.runs) == len(self._begun)
            and INPUT_READERS.keys() <= set(self.recording.topics.by_name.values())
        )

    def replay_with(self, assignments: Sequence[str], update: ReportTime) -> list[Divergence]:
        """Compare duties and jobs of another controller with the recorded ones, run by run.

        Its parameters, as ``controller.param=value``, apply for the whole of each run, also if they
        were changed on the way, and stay in effect. It raises ParameterError if one is not a
        parameter of the controller, or its value is not allowed.
        """
        for assignment in assignments:
            if not assignment.startswith(f'{CONTROLLER}.'):
                raise ParameterError(
                    f'--set {assignment}: a replay can only change parameters of the {CONTROLLER}'
                )
            for job in self.runs:
                before = job.implementation
                assign(job.parameters, assignment)
                after = job.implementation
                if before != after and not {before, after} <= set(DOCUMENTS_PROGRAM):
                    raise ParameterError(
                        f'--set {assignment}: only {public_reference(before)} can replay this run'
                    )
            name = assignment.partition('=')[0].partition('.')[2]
            self.runs = [job.without_changes_of(name) for job in self.runs]
        self.controllers = [
            replace(each, replayed=public_reference(job.implementation))
            for each, job in zip(self.controllers, self.runs, strict=True)
        ]
        done = 0.0
        divergences = []
        for job in self.runs:
            divergence, comparator = Divergence(), self._comparator([BRICK_TASKS])
            for tick in replay_controller(job, comparator):
                if tick.stamp_ns in job.inputs.duties:
                    duty = job.inputs.duties[tick.stamp_ns]
                    divergence.add(tick.stamp_ns, duty, tick.outputs.duty)
                done += TICK_S
                update(done)
            for epoch, topic, raw in self.recording.messages([BRICK_TASKS]):
                if job.inputs.run.has(epoch, raw.stamp_ns) and raw.stamp_ns <= job.inputs.last_ns:
                    comparator.add_recorded(topic, [raw.stamp_ns], [raw.data], epoch)
            divergence.jobs = comparator.first_difference(complete=False)
            divergences.append(divergence)
        return divergences

    def _recorded_devices(self, job: RunToRepeat) -> list[AnyDeviceMessages]:
        """Return the devices whose drivers are nodes of other packages."""
        foreign = [each.role for each in self._foreign_drivers(job)]
        return [each for each in DEVICE_MESSAGES if each.sample.publisher in foreign]

    def _comparator(self, topics: Iterable[Topic]) -> MessageComparator:
        recorded = self.recording.topics.by_name.values()
        return MessageComparator([topic for topic in topics if topic in recorded])

    def _compare(
        self,
        subject: str,
        jobs: Sequence[RunToRepeat],
        comparator: MessageComparator,
        engines: Iterator[Engine],
        update: ReportTime,
    ) -> ReplayResult:
        """Compare messages while `engines` makes the ticks, and says what has made each."""
        ticks = Counter[Engine]()
        for engine in engines:
            ticks[engine] += 1
            update(ticks.total() * TICK_NS / SECOND_NS)
        compare_events(self.recording, [job.inputs for job in jobs], comparator)
        difference = comparator.first_difference(complete=self.recording.reader.complete)
        engine = Engine.COMPILED if set(ticks) == {Engine.COMPILED} else Engine.INTERPRETED
        messages = comparator.compared()
        return ReplayResult(subject, ticks.total(), messages, difference, engine=engine)

    def _context(self, job: RunToRepeat, stamp_ns: int) -> list[ReplayedTick]:
        """Return the recorded inputs around a tick, and the controller's outputs for them."""
        margin_ns = CONTEXT_TICKS * TICK_NS
        found = []
        for tick in replay_controller(job, MessageComparator(())):
            if tick.stamp_ns > stamp_ns + margin_ns:
                break
            if tick.stamp_ns >= stamp_ns - margin_ns:
                found.append(tick)
        return found


def _nothing_to_replay_by(path: Path) -> str:
    return (
        f'{path}: cannot replay: {PARAMETERS} is not attached, and no participant has announced '
        'its parameters'
    )


def _attached_parameters(reader: RecordingReader, scratch: Path) -> ParameterSet | None:
    """Return the attached parameters, if any."""
    attached = reader.attachments()
    if PARAMETERS not in attached:
        return None
    file = scratch / PARAMETERS
    write_temporary(file, attached[PARAMETERS].data)
    try:
        return read_parameter_file(file)
    except BallbotError as error:
        text = str(error).replace(str(file), f'{reader.path}: {PARAMETERS}')
        raise RecordingError(text) from None
