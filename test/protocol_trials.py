"""Trials of the whole protocol: a run, several faults at random moments, and what must hold.

A seed and a number give a trial; the same trial has the same events, to the last delay.
"""

import random
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

import numpy as np
from parts import steps
from protocol_world import DRIVER_NODES, PERIODIC, Process, ProtocolWorld, RecorderNode

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Objection
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes.teleop.sticks import JOY
from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVERS,
    GAMEPAD,
    GYRO,
    PLANT,
    RECORDER,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import decode_duty, encode_duty, is_stop
from ballbot_ros.recording.messages.devices import INPUT_READERS
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    GYRO_IMU,
    JOINT_STATES,
    LOCKSTEP_PUBLISHERS,
    MOTOR_DUTY,
    PARTICIPANTS,
    PLANT_IMU,
    PUSH,
    RECORDER_ACK,
    ROLL_CALL,
    RUN,
)

SCENARIO = Scenario(
    vertical=steps((0.0, 0), (0.04, -60), (0.1, 30)), horizontal=steps((0.0, 0), (0.06, 100))
)
NODES = (*DRIVERS, CONTROLLER, RECORDER)
"""The nodes that a command starts next to the plant."""

LIMIT_S = 120.0
"""Time after which a run that has not ended waits for ever."""

CLOSING_S = 1.5
"""Time after the end of a run within which the last messages reach the recorder."""

RESTART_S = 1.0
"""Time that the roll calls need to find out that a node has a successor."""

TASKS = ('task_ts1', 'task_ts2', 'task_ts3')


def parameters_of(ticks, **plant):
    """Return the parameters of a short run in which every input matters after 20 ms."""
    found = ParameterSet()
    found.set(GYRO, 'noise', 0.7)
    found.set(CONTROLLER, 'time_start', 20)
    found.set(CONTROLLER, 'rejoin', plant.pop('rejoin', False))
    values = {'start_pitch_x': 0.04, 'hold_time': 0.02, 'battery_model': 'draining', **plant}
    for name, value in {'duration': ticks * TICK_NS * 1e-9, **values}.items():
        found.set(PLANT, name, value)
    return found


class ExternalInputs:
    """The sticks and pushes of a run as the robot received them."""

    def __init__(self, sticks, pushes):
        self._sticks, self._pushes = sticks, pushes

    def sticks_at(self, time):
        return self._sticks[round(time * 1e9)]

    def pushes_from(self, start_ns):
        return self._pushes


class Golden:
    """The inputs and duties of an undisturbed run, tick by tick."""

    def __init__(self, start_ns, inputs=None):
        self._loop = ClosedLoop(parameters_of(1), inputs or SCENARIO, start_ns)
        self._ticks = []

    def tick(self, number):
        while len(self._ticks) <= number:
            tick = self._loop.tick()
            self._ticks.append((tick.inputs, tick.outputs.duty))
        return self._ticks[number]

    def duties(self, count):
        return np.array([self.tick(each)[1] for each in range(count)], dtype=np.int8).reshape(-1, 2)


golden_from = cache(Golden)


@dataclass
class Fault:
    """A fault that a trial has applied.

    Attributes
    ----------
    kind, what : str
        Its name in :data:`FAULTS`, and what exactly happens.
    names : tuple of str
        One of these is in the reason of a run that fails because of it.
    costs_s : float or None
        How long the run may have to wait because of it; None if it may fail.
    is_foreign : bool
        Whether samples of others than the participants may arrive because of it.
    forgets : bool
        Whether the answers to live inputs may be lost, so that they are given again.
    """

    kind: str
    what: str
    names: tuple = ()
    costs_s: float | None = None
    is_foreign: bool = False
    forgets: bool = False


class Violation(Exception):  # noqa: N818
    """Something that must hold does not hold."""


class Director(Process):
    """Applies the faults."""

    topics = ()

    def __init__(self, world):
        super().__init__(world, 'director')
        self.topics = ()


class Stranger(Process):
    """A node that takes part in nothing, but publishes on a topic of the loop."""

    latched = MappingProxyType({})

    def __init__(self, world, role, name):
        super().__init__(world, 'stranger', name)
        self.topics = (role,)


class OtherPlant(Process):
    """A plant on another machine, which announces its run once."""

    host = 'there'
    latched = MappingProxyType({})

    def __init__(self, world, role, name):
        super().__init__(world, 'stranger', name)
        self.topics = (CLOCK.name, RUN.name, ROLL_CALL.name)


@dataclass
class Trial:
    """A run with faults.

    Parameters
    ----------
    seed, number : int
        Seed of all choices, and number of the trial.
    world_kind : type
        Its class of :class:`ProtocolWorld`.
    keeps_log : bool
        Whether to keep the text of all events.
    kinds : sequence of str
        The kinds of faults to draw from.
    """

    seed: int
    number: int
    world_kind: type = ProtocolWorld
    keeps_log: bool = False
    kinds: tuple = ()
    faults: list = field(default_factory=list)

    def __post_init__(self):
        chance = self.chance = random.Random(f'trial {self.seed} {self.number}')
        self.count = chance.randint(6, 45)
        self.requires_recorder = chance.random() < 0.7
        self.timeout_s = chance.choice((0.5, 1.0, 2.0))
        self.startup_s = chance.choice((1.0, 3.0))
        self.rejoin = chance.random() < 0.5
        parameters = parameters_of(
            self.count,
            timeout=self.timeout_s,
            startup_timeout=self.startup_s,
            require_recorder=self.requires_recorder,
            real_time_factor=chance.choice((0.0, 0.0, 0.0, 1.0)),
            rejoin=self.rejoin,
        )
        self.world = self.world_kind(
            parameters, SCENARIO, f'{self.seed} {self.number}', keeps_log=self.keeps_log
        )
        self.world.watcher = self
        self.director = Director(self.world)
        self._is_live = False
        self.forged = []
        self.begun_s = self.world.now_s
        self._draw()

    # The plan of a trial

    def _draw(self):
        chance, world, kinds = self.chance, self.world, self.kinds or tuple(FAULTS)
        order = [*NODES, PLANT]
        chance.shuffle(order)
        spread_s = chance.choice((0.0, 0.05, 0.3))
        for role in order:
            world.call_in(chance.uniform(0.0, spread_s), self.director, self._start, role)
        self._pending = []
        for _ in range(chance.choice((0, 1, 1, 2, 2, 3, 4))):
            (apply,) = chance.choices(kinds, [FAULTS[kind] for kind in kinds])
            moment = chance.choice(('start', 'start', 'tick', 'tick', 'tick', 'last'))
            if moment == 'start':
                world.call_in(chance.uniform(0.0, 0.4), self.director, self._apply, apply)
            else:
                tick = self.count - (moment == 'last') if moment == 'last' else None
                tick = tick if tick is not None else chance.randrange(self.count)
                self._pending.append((tick, len(self._pending), apply))
        self._pending.sort(key=lambda each: each[:2])

    def _start(self, role):
        process = self.world.start(role)
        if role != PLANT:
            self.world.started.append(process)

    def _apply(self, kind):
        if self.summary is None:
            self._kind = kind
            APPLY[kind](self)

    def note(self, what, *names, **details):
        """Note a fault that is being applied."""
        self.world.note(f'fault: {what}')
        if not self.faults:
            self.begun_s = self.world.now_s
        self.faults.append(Fault(self._kind, what, tuple(map(str, names)), **details))

    def later(self, delay_s, event, *what):
        self.world.call_in(delay_s, self.director, event, *what)

    def force_live(self):
        """Note that the duties now depend on more than the scenario."""
        self._is_live = True

    def living(self, *roles):
        return [each for each in self.world.nodes if each.is_alive and each.role in roles]

    @property
    def took_s(self):
        """Time from the first fault to the end [s]."""
        return self.world.now_s - self.begun_s

    @property
    def summary(self):
        return self.world.plant.master.summary if self.world.plant else None

    @property
    def is_foreign(self):
        forgets = self._is_live and any(fault.forgets for fault in self.faults)
        return forgets or any(fault.is_foreign for fault in self.faults)

    # The course of a trial

    def run(self):
        """Run the trial to its end; raise a Violation as soon as something does not hold."""
        world = self.world
        end_s = world.now_s + LIMIT_S
        while self.summary is None:
            if world.now_s > end_s:
                raise Violation('the run waits for ever')
            world.step()
            self._check_progress()
        end_s = world.now_s + CLOSING_S
        while world.next_s < end_s:
            world.step()
        self._judge()
        return self

    def _check_progress(self):
        world = self.world
        plant = world.plant
        ticks = plant.master.log.ticks if plant else 0
        while self._pending and self._pending[0][0] <= ticks and plant and ticks:
            self._apply(self._pending.pop(0)[2])

    def on_tick(self, controller, stamp_ns, inputs, outputs):
        """Check the inputs and duties of a controller's tick at once, unless others interfere."""
        if self._is_live or self.is_foreign:
            return
        start_ns = controller.member.run.start_ns
        golden = golden_from(start_ns).tick((stamp_ns - start_ns) // TICK_NS)
        due = [
            (known, mine)
            for known, mine in zip(golden[0], inputs, strict=True)
            if known is not None
        ]
        if any(known != mine for known, mine in due):
            raise Violation(f'the controller received {inputs} instead of {golden[0]}')
        if golden[1] != outputs.duty:
            raise Violation(f'the duty is {outputs.duty} instead of {golden[1]}')

    def on_acknowledged(self, recorder, acked_ns):
        """Check that a recorder has what it acknowledges."""
        start_ns = recorder.member.run.start_ns if recorder.member.run else 0
        is_sure = not (recorder.lost or recorder.has_objected)
        if acked_ns < start_ns or not is_sure or not self._is_founder(recorder):
            return
        for name, topic in PERIODIC.items():
            newest_ns = acked_ns - acked_ns % topic.period_ns
            if newest_ns >= start_ns and newest_ns not in recorder.stamps(name):
                raise Violation(f'the recorder has acknowledged {newest_ns} without {name}')

    def _is_founder(self, recorder):
        """Return whether a recorder takes part in the run from its start."""
        plant, run = self.world.plant, recorder.member.run
        is_in_run = run and run.name == plant.master.state()['run name']
        # Another plant may have called it away for a while.
        is_faithful = len(recorder.runs) == len(set(recorder.runs))
        return is_in_run and is_faithful and recorder.instance in plant.founders

    # The judgement

    def _judge(self):
        summary = self.summary
        self.world.note(f'{summary.outcome} {summary.ticks} {summary.duty_sha256} {summary.reason}')
        for recorder in self.living(RECORDER):
            if not recorder.is_suspended:
                recorder.close()
        if summary.outcome is Outcome.COMPLETED:
            self._judge_completed(summary)
        elif summary.outcome is Outcome.FAILED:
            self._judge_failed(summary)
        else:
            raise Violation(f'the run was {summary.outcome}')
        self._judge_recordings(summary)

    def _judge_completed(self, summary):
        if summary.ticks != self.count:
            raise Violation(f'passed with {summary.ticks} ticks of {self.count}')
        if self.forged:
            return
        duties = self.world.plant.master.log.trajectory().duty
        expected = self._golden(summary).duties(self.count)
        wrong = (duties != expected).any(axis=1)
        if wrong.any():
            raise Violation(f'passed with other duties from tick {np.argmax(wrong)} on')

    def _golden(self, summary):
        if not (self._is_live or summary.external_pushes):
            return golden_from(summary.start_ns)
        sticks = {}
        for stamp_ns, (_, inputs, _) in self.world.ticks.items():
            if stamp_ns >= summary.start_ns and stamp_ns % 20_000_000 == 0:
                if inputs.sticks not in self.world.sticks.get(stamp_ns, ()):
                    raise Violation(f'no gamepad has sent the sticks {inputs.sticks}')
                sticks[stamp_ns - summary.start_ns] = inputs.sticks
        return Golden(summary.start_ns, ExternalInputs(sticks, summary.external_pushes))

    def _judge_failed(self, summary):
        costs_s = [fault.costs_s for fault in self.faults]
        is_harmless = None not in costs_s and sum(costs_s) < 0.8 * min(
            self.timeout_s, self.startup_s
        )
        if is_harmless:
            raise Violation(f'failed without a reason to: {summary.reason}')
        names = {name for fault in self.faults for name in fault.names}
        if not any(name in summary.reason for name in names):
            raise Violation(f'the reason names nobody who is at fault: {summary.reason}')
        who, is_silence, _ = summary.reason.partition(' silent for ')
        if is_silence:
            for each in who.split(', '):
                if not any(name in each for name in names):
                    raise Violation(f'the reason names {each}: {summary.reason}')

    def _judge_recordings(self, summary):
        """Judge whether the recordings have what the controller received."""
        passed = summary.outcome is Outcome.COMPLETED
        last_ns = summary.start_ns + (summary.ticks - 1) * TICK_NS
        for recorder in self.world.nodes:
            if not isinstance(recorder, RecorderNode) or not self._is_founder(recorder):
                continue
            self._judge_samples(recorder, summary.start_ns)
            begins_ns = recorder.recording.gate.complete_from_ns
            plants = {name.split()[1] for name in recorder.runs}
            is_late = begins_ns > summary.start_ns and len(plants) == 1
            if passed and is_late and not (recorder.lost or self.is_foreign):
                raise Violation(f'passed, but the recording is complete only from {begins_ns} on')
            is_whole = recorder.is_alive and not (recorder.lost or is_late)
            duties = recorder.file.get(MOTOR_DUTY.name, ())
            stops = [1 for at_ns, data in duties if is_stop(data) and at_ns > summary.start_ns]
            is_reached = recorder.is_alive and not recorder.is_suspended
            if is_reached and summary.ticks and not passed and not stops:
                raise Violation('failed, but the recording has no motor stop')
            if passed and stops:
                raise Violation('passed, but the recording has a motor stop')
            if passed and is_whole and not recorder.is_suspended:
                for name, topic in PERIODIC.items():
                    due = range(summary.start_ns, last_ns + 1, topic.period_ns)
                    if missing := set(due) - recorder.stamps(name):
                        raise Violation(f'passed, but {name} lacks {sorted(missing)[:5]}')

    def _judge_samples(self, recorder, start_ns):
        for topic, read in INPUT_READERS.items():
            recorded = {}
            for stamp_ns, data in recorder.file.get(topic.name, ()):
                recorded.setdefault(stamp_ns, []).append(data)
            self._compare(topic, recorded, start_ns, read)
        duties = {}
        for stamp_ns, data in recorder.file.get(MOTOR_DUTY.name, ()):
            duties.setdefault(stamp_ns, []).append(data)
        self._compare(MOTOR_DUTY, duties, start_ns, decode_duty)

    def _compare(self, topic, recorded, start_ns, read):
        """Compare recorded samples with those that the controller received, or its duties."""
        for stamp_ns, found in recorded.items():
            if stamp_ns not in self.world.ticks or stamp_ns < start_ns:
                continue
            if len(found) > 1 and not self.is_foreign:
                raise Violation(f'{len(found)} samples of {topic.name} at {stamp_ns}')
            _, inputs, duty = self.world.ticks[stamp_ns]
            expected = duty if topic is MOTOR_DUTY else getattr(inputs, FIELDS[topic.name])
            if self.is_foreign:
                continue
            if all(read(each) != expected for each in found if each):
                raise Violation(f'{topic.name} at {stamp_ns} is not what the controller received')


FIELDS = {
    **{each.sample.name: each.device.field for each in DRIVER_NODES.values()},
    'gamepad': 'sticks',
    'battery_state': 'battery_mv',
}

# Faults


def kill(trial):
    """Kill a node, or end it in an orderly way, and perhaps start it again."""
    victims = trial.living(*NODES)
    if victims:
        victim = trial.chance.choice(victims)
        end = trial.chance.choice((trial.world.kill, trial.world.kill, trial.world.leave))
        restarts = trial.chance.random() < 0.6
        delay_s = trial.chance.uniform(0.0, 0.5)
        is_harmless = restarts and victim.role in DRIVERS
        trial.note(
            f'{end.__name__} {victim.role}',
            victim.role,
            victim.pid,
            costs_s=delay_s + RESTART_S if is_harmless else None,
            # A successor of the controller answers from its initial state.
            is_foreign=victim.role == CONTROLLER,
            forgets=victim.role == GAMEPAD,
        )
        end(victim)
        if restarts:
            trial.later(delay_s, trial.world.start, victim.role)


def suspend(trial):
    """Suspend a process for a while, or for ever."""
    victims = trial.living(*NODES, PLANT)
    victims = [each for each in victims if not each.is_suspended]
    if victims:
        victim = trial.chance.choice(victims)
        is_plant = victim.role == PLANT
        ends = is_plant or trial.chance.random() < 0.8
        length_s = trial.chance.choice((0.05, 0.3, 1.0, 4.0)) * trial.chance.uniform(0.2, 1.0)
        names = () if is_plant else (victim.role, victim.pid)
        costs_s = length_s + 0.2 if ends else None
        trial.note(f'suspend {victim.role} {length_s:.3f} {ends}', *names, costs_s=costs_s)
        trial.world.suspend(victim)
        if ends:
            trial.later(length_s, trial.world.resume, victim)


def starve(trial):
    """Give a process no processor for a while, which does not count as its silence."""
    victims = [each for each in trial.living(*NODES, PLANT) if not each.is_suspended]
    if victims:
        victim = trial.chance.choice(victims)
        length_s = trial.chance.choice((0.3, 2.0, 6.0)) * trial.chance.uniform(0.2, 1.0)
        trial.note(f'starve {victim.role} {length_s:.3f}', costs_s=0.2)
        trial.world.suspend(victim, is_starved=True)
        trial.later(length_s, trial.world.resume, victim)


def lag(trial):
    """Delay all messages for a while."""
    lag_s = trial.chance.uniform(0.0, trial.timeout_s / 20)
    length_s = trial.chance.uniform(0.1, 2.0)
    trial.note(f'lag {lag_s:.3f}', costs_s=4 * lag_s)
    trial.world.lag_s = lag_s
    trial.later(length_s, setattr, trial.world, 'lag_s', 0.0)


def slow_discovery(trial):
    """Let some nodes that start from now on discover each other late."""
    trial.note('slow discovery', *NODES, costs_s=1.6)
    trial.world.slow_discovery = 0.3


def mute(trial):
    """Let a driver answer roll calls, but send no samples, for a while or for ever."""
    victims = trial.living(*DRIVERS)
    if victims:
        victim = trial.chance.choice(victims)
        ends = trial.chance.random() < 0.7
        length_s = trial.chance.uniform(0.05, 2.0)
        costs_s = length_s + 0.2 if ends else None
        # If only the recorder lacks its sample, the recorder's acknowledgement is missing.
        trial.note(f'mute {victim.role}', victim.role, RECORDER, costs_s=costs_s)
        victim.is_mute = True
        if ends:
            trial.later(length_s, setattr, victim, 'is_mute', False)


def disturb_timers(trial):
    """Lose, repeat or shift a callback of the controller's timers."""
    for controller in trial.living(CONTROLLER):
        brick, task = controller.brick, trial.chance.choice(TASKS)
        trial.note(f'timer of {task}', costs_s=0.2)
        if controller.member.run and not controller.is_suspended:
            trial.chance.choice((brick.dropped.add, brick.release, brick.shift))(task)


def stranger(trial):
    """Publish on a topic of the loop without taking part."""
    chance, world = trial.chance, trial.world
    topic = chance.choice(
        (GYRO_IMU, JOINT_STATES, MOTOR_DUTY, PLANT_IMU, RECORDER_ACK, PARTICIPANTS)
    ).name
    name = chance.choice(('/intruder', '/gyro_driver'))
    other = world.start(topic, name, Stranger)
    content = chance.choice(('now', 'now', 'ahead', 'old', 'silent'))
    # The gyro driver answers a foreign truth with a second sample of its own.
    names = (name, topic, GYRO_IMU.name) if topic == PLANT_IMU.name else (name, topic)
    if topic in (MOTOR_DUTY.name, RECORDER_ACK.name):
        # If it answers for a dead controller, or for a recorder that lacks the tick, and leaves,
        # the recorder waits in vain, and is named as well (docs/reliability.md, known limits).
        names += (RECORDER,)
    names += ('by a node that has left',)
    trial.note(f'stranger on {topic}: {content}', *names, is_foreign=True)
    if content != 'silent':
        for _ in range(chance.choice((1, 1, 5, 30))):
            trial.later(chance.uniform(0.06, 1.0), _send_foreign, trial, other, topic, content)
    if chance.random() < 0.5:
        trial.later(chance.uniform(0.1, 3.0), lambda: other.is_alive and world.leave(other))


def _send_foreign(trial, other, topic, content):
    world = trial.world
    if not (other.is_alive and world.plant):
        return
    now_ns = world.plant.master.time_ns
    stamp_ns = {'now': now_ns, 'ahead': now_ns + 10**10, 'old': TICK_NS}[content]
    if topic == PARTICIPANTS.name:
        other.publish(topic, None)
    elif topic == RECORDER_ACK.name:
        other.publish(topic, stamp_ns)
    else:
        if content == 'now' and _is_owed(trial, topic, stamp_ns):
            # Nobody contradicts a sample that a dead node owes (docs/reliability.md, known limits).
            trial.forged.append(stamp_ns)
        other.publish(topic, FOREIGN[topic](stamp_ns))


def _is_owed(trial, topic, stamp_ns):
    """Return whether a node that a fault has hit has not yet sent a sample."""
    hit = {name for fault in trial.faults for name in fault.names}
    is_hit = not hit.isdisjoint(LOCKSTEP_OWNERS[topic])
    return is_hit and (topic, stamp_ns) not in trial.world.sent


def foreign_samples():
    """Return functions that make valid messages with other content than any participant's."""
    duty = {MOTOR_DUTY.name: lambda stamp_ns: encode_duty(stamp_ns, (77, -77))}
    readings = {GYRO_IMU.name: (200, 300), JOINT_STATES.name: (5, -9)}
    makers = {}
    for each in DRIVER_NODES.values():
        if each.sample.name in readings:
            encode = each.encoder(ParameterSet().of(each.device.parameters))
            reading = readings[each.sample.name]
            makers[each.sample.name] = lambda stamp_ns, encode=encode, reading=reading: encode(
                stamp_ns, reading
            )
    return {**makers, **duty, PLANT_IMU.name: makers[GYRO_IMU.name]}


FOREIGN = foreign_samples()
LOCKSTEP_OWNERS = {
    topic.name: [role for role in roles if role != PLANT] or [PLANT]
    for topic, roles in LOCKSTEP_PUBLISHERS.items()
}


def second_node(trial):
    """Start a second node of a role, perhaps one that a stopped earlier run has left."""
    chance, world = trial.chance, trial.world
    role = chance.choice(NODES)
    second = world.start(role)
    if chance.random() < 0.3:
        second.member.join(RunIdentity('1 earlier', FIRST_TICK_NS))
        second.is_suspended = chance.random() < 0.5
    trial.note(f'second {role}', role, second.pid, is_foreign=True)
    if chance.random() < 0.5:
        end = chance.choice((world.kill, world.leave))
        trial.later(chance.uniform(0.02, 2.0), lambda: second.is_alive and end(second))


def second_plant(trial):
    """Start a plant on another machine."""
    world = trial.world
    other = world.start(CLOCK.name, '/other_plant', OtherPlant)
    trial.note(
        'second plant', 'another plant', 'another run', '/other_plant', *NODES, is_foreign=True
    )
    run = RunIdentity('1 other', FIRST_TICK_NS)

    def announce():
        other.publish(RUN.name, run)
        other.publish(ROLL_CALL.name, run)

    trial.later(0.06, announce)


def restart_plant(trial):
    """Kill the plant, and start another one that the same nodes serve."""
    world = trial.world
    if world.plant and world.plant.is_alive and not world.plant.is_suspended:
        trial.note('plant killed and restarted', PLANT, world.plant.pid, *NODES)
        world.kill(world.plant)
        world.ticks.clear()
        trial.later(trial.chance.uniform(0.0, 0.5), _start_plant, trial)


def _start_plant(trial):
    for recorder in trial.living(RECORDER):
        if recorder.is_suspended:
            # Messages of both plants wait for it in any order (docs/reliability.md, known limits).
            recorder.lost.append('samples of the run before')
    trial.world.start(PLANT)


def pause(trial):
    """Pause the plant, run some steps, and resume."""
    plant = trial.world.plant
    if plant and plant.is_alive:
        trial.note('pause', costs_s=0.0)
        length_s = trial.chance.uniform(0.0, 3.0)
        request(trial, 'set_paused', is_paused=True)
        for _ in range(trial.chance.randrange(4)):
            trial.later(trial.chance.uniform(0.0, length_s), request, trial, 'step')
        trial.later(length_s, lambda: request(trial, 'set_paused', is_paused=False))


def request(trial, name, *what, **details):
    """Call a service of the plant, which answers the calls in their order."""
    plant = trial.world.plant
    event = getattr(plant.master, name)
    trial.world.call_in(0.0, plant, lambda: plant.dispatch(event, *what, **details))


def reset(trial):
    """Begin a new run."""
    plant = trial.world.plant
    if plant and plant.is_alive and not plant.is_suspended and plant.master.state()['run']:
        trial.note('reset', costs_s=0.0)
        request(trial, 'reset')


def change_pace(trial):
    """Set another pace."""
    plant = trial.world.plant
    if plant and plant.is_alive and not plant.is_suspended:
        trial.note('pace', costs_s=0.0)
        values = trial.world.parameters
        values.set(PLANT, 'real_time_factor', trial.chance.choice((0.0, 0.5, 2.0)))
        plant.parameters = values.of(PlantParameters)
        request(trial, 'on_parameters', plant.parameters)


def push(trial):
    """Push the robot from outside."""
    plant = trial.world.plant
    if plant and plant.is_alive and not plant.is_suspended:
        trial.note(f'push on {PUSH.name}', costs_s=0.0)
        trial.force_live()
        request(trial, 'on_push', 0, (0.3, -0.2), (0.0, 0.0))


def drive(trial):
    """Move the sticks by hand."""
    trial.force_live()
    trial.note('sticks', costs_s=0.0)
    for _ in range(trial.chance.randint(1, 5)):
        sticks = trial.chance.randint(-100, 100), trial.chance.randint(-100, 100)
        trial.later(trial.chance.uniform(0.0, 0.5), _report, trial, sticks)


def _report(trial, sticks):
    for gamepad in trial.living(GAMEPAD):
        gamepad.sources.report(JOY, sticks, trial.world.now_s)


def give_up(trial):
    """Let a recorder or a controller fail by itself."""
    victims = trial.living(trial.chance.choice((RECORDER, CONTROLLER)))
    if victims and not victims[0].is_suspended:
        node = victims[0]
        trial.note(f'{node.role} gives up', node.role, node.pid, is_foreign=node.role == CONTROLLER)
        node.object(Objection(f'{node.role}: No space left on device'))
        trial.later(0.01, lambda: node.is_alive and trial.world.leave(node))


FAULTS = {
    'nodes killed or ended': 3,
    'processes suspended': 3,
    'processes without a processor': 2,
    'slow messages': 1,
    'slow discovery': 1,
    'silent drivers': 1,
    'timer callbacks lost or repeated': 1,
    'a stranger in the loop': 2,
    'a second node in a role': 1,
    'a second plant': 1,
    'the plant killed and restarted': 1,
    'pause and step': 1,
    'reset': 1,
    'another pace': 1,
    'pushes from outside': 1,
    'sticks moved by hand': 1,
    'a node gives up': 1,
}
"""The kinds of faults, and how often each is drawn."""

APPLY = dict(
    zip(
        FAULTS,
        (
            kill, suspend, starve, lag, slow_discovery, mute, disturb_timers, stranger, second_node,
            second_plant, restart_plant, pause, reset, change_pace, push, drive, give_up,
        ),
        strict=True,
    )
)  # fmt: skip
