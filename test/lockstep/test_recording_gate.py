"""The selection of messages for a recording: tables of messages, and random strangers."""

import random

import pytest

from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.recording_order import MAX_AHEAD_NS, RecordingGate, Stream
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS, TICK_NS

MS = 1_000_000
START = 1000 * MS
WALL_NS = 1_795_000_000 * 1_000 * MS


def bare(one, other):
    return one == other


class File:
    """A recording in memory, with the gate's objections and reports."""

    def __init__(self, run='1 abc', start_ns=START):
        self.clock = Stream('/clock', period_ns=TICK_NS, is_clock=True, is_live=True, is_same=bare)
        self.gyro = Stream('/gyro', period_ns=TICK_NS, is_same=bare)
        self.sonar = Stream('/sonar', period_ns=SLOW_PERIOD_NS, is_same=bare)
        self.state = Stream('/operating_state')
        self.joy = Stream('/joy', is_live=True, is_shared=True)
        self.map = Stream('/map', is_live=True)
        self.streams = (self.clock, self.gyro, self.sonar, self.state, self.joy, self.map)
        self.numbers = dict.fromkeys(self.streams, 0)
        self.kept, self.objections, self.lost, self.crowded = [], [], [], set()
        self.gate = RecordingGate(self)
        self.gate.takes_part = True
        if run:
            self.begin(run, start_ns)

    def begin(self, run, start_ns):
        return self.gate.begin(RunIdentity(run, start_ns), self.streams)

    def keep(self, stream, log_ns, data, sequence):
        self.kept.append((stream.name, log_ns // MS, data))

    def raise_objection(self, stream, stamp_ns):
        self.objections.append((stream.name, stamp_ns // MS))

    def report_loss(self, stream, sequence):
        self.lost.append((stream.name, sequence))

    def has_several_publishers(self, stream):
        return stream.name in self.crowded

    def take(self, stream, stamp_ms, data=b'true', sequence=None):
        self.numbers[stream] += 1
        number = self.numbers[stream] if sequence is None else sequence
        self.gate.take(stream, stamp_ms * MS, data, number)

    def tick(self, now_ms):
        self.take(self.clock, now_ms)
        self.take(self.gyro, now_ms)
        if now_ms * MS % SLOW_PERIOD_NS == 0:
            self.take(self.sonar, now_ms)

    def of(self, name):
        return [(stamp, data) for topic, stamp, data in self.kept if topic == name]


def test_every_message_of_a_run_passes_once_with_its_stamp():
    file = File()
    for now in (1000, 1004, 1008):
        file.tick(now)
        file.tick(now)
    file.take(file.state, 0, b'balance')
    expected = [b'true'] * 3
    assert file.of('/gyro') == list(zip((1000, 1004, 1008), expected, strict=True))
    assert file.of('/sonar') == [(1000, b'true')]
    assert file.of('/operating_state') == [(1008, b'balance')]
    assert file.objections == file.lost == []
    assert file.gyro.complete_ns == file.clock.complete_ns == 1008 * MS
    assert file.sonar.complete_ns == 1016 * MS


def test_a_sample_that_overtakes_the_clock_waits_for_it():
    file = File()
    file.take(file.gyro, 1000)
    assert file.kept == []
    file.take(file.clock, 1000)
    file.take(file.gyro, 1004)
    assert file.gyro.newest_ns == 1000 * MS
    file.take(file.clock, 1004)
    assert file.of('/gyro') == [(1000, b'true'), (1004, b'true')]


def test_leftover_messages_of_an_earlier_run_do_not_pass():
    file = File()
    file.take(file.gyro, 5000, b'left')
    file.take(file.state, 0, b'left')
    file.take(file.sonar, 400, b'left')
    file.take(file.clock, 996, b'left')
    file.take(file.map, 0, b'map of this run')
    file.tick(1000)
    assert b'left' not in [data for _, _, data in file.kept]
    assert file.of('/map') == [(1000, b'map of this run')]
    assert file.objections == []


def test_a_late_recorder_gets_the_messages_kept_for_it():
    file = File()
    file.take(file.state, 0, b'calibration')
    file.take(file.gyro, 1400)
    file.take(file.gyro, 1404)
    for now in (1400, 1404):
        file.take(file.clock, now)
    assert file.of('/operating_state') == [(1400, b'calibration')]
    assert [stamp for stamp, _ in file.of('/gyro')] == [1400, 1404]


def test_a_late_recorder_knows_from_when_on_it_has_everything():
    file = File()
    file.take(file.clock, 1192)
    for now in (1196, 1200, 1204, 1220):
        file.tick(now)
    assert file.gate.complete_from_ns == 1200 * MS  # the first sample of the sonar
    file.begin('1 other', 3000 * MS)  # which it records from its start on
    file.tick(3000)
    assert file.gate.complete_from_ns == 1200 * MS
    file.gate.takes_part = False  # of a player, which may begin anywhere
    assert file.gate.complete_from_ns == 0
    early = File()
    for now in (1000, 1004, 1100, 1104):
        early.tick(now)
    assert early.gate.complete_from_ns == 0


@pytest.mark.parametrize('is_first', [False, True])
def test_a_contradiction_causes_an_objection_and_loses_nothing_of_the_run(is_first):
    file = File()
    file.tick(1000)
    file.take(file.clock, 1004)
    for data in (b'false', b'true')[:: 1 if is_first else -1]:
        file.take(file.gyro, 1004, data)
    file.tick(1008)
    assert (1004, b'true') in file.of('/gyro')
    assert file.objections == [('/gyro', 1004)]


@pytest.mark.parametrize('stamp_ms', [1000 + MAX_AHEAD_NS // MS + 4, WALL_NS // MS])
def test_a_stamp_of_another_clock_causes_an_objection_and_is_omitted(stamp_ms):
    file = File()
    file.tick(1000)
    file.take(file.gyro, stamp_ms, b'stranger', sequence=1)
    for now in (1004, 1008):
        file.tick(now)
    assert [data for _, data in file.of('/gyro')] == [b'true'] * 3
    assert file.objections == [('/gyro', stamp_ms)]


def test_a_forged_future_sample_does_not_replace_the_genuine_one():
    file = File()
    file.tick(1000)
    file.take(file.gyro, 1012, b'guess')
    for now in (1004, 1008, 1012, 1016):
        file.tick(now)
    assert [stamp for stamp, data in file.of('/gyro') if data == b'true'] == [
        1000, 1004, 1008, 1012, 1016,
    ]  # fmt: skip
    assert file.objections == [('/gyro', 1012)]


@pytest.mark.parametrize(('crowded', 'objections'), [(True, [('/clock', 90_000)]), (False, [])])
def test_a_jump_of_the_clock_is_a_players_or_another_simulations(crowded, objections):
    file = File()
    file.tick(1000)
    file.crowded = {'/clock'} if crowded else set()
    file.take(file.clock, 90_000)
    assert file.objections == objections
    assert file.gate.now_ns == (1000 if crowded else 90_000) * MS


def test_another_simulations_clock_stays_one_after_the_plant_has_left():
    file = File()
    file.tick(1000)
    file.crowded = {'/clock'}
    file.take(file.clock, 90_000, sequence=700)
    file.crowded = set()
    file.take(file.clock, 90_020, sequence=702)
    assert file.objections == [('/clock', 90_000), ('/clock', 90_020)]
    assert file.lost == []
    assert file.gate.now_ns == 1000 * MS
    file.begin('2 abc', 2000 * MS)
    file.take(file.clock, 90_000)
    assert file.gate.now_ns == 90_000 * MS


@pytest.mark.parametrize(
    ('events', 'lost'),
    [
        ([('gyro', 1004, 2), ('gyro', 1008, 3)], []),
        ([('clock', 1004, 2), ('gyro', 1008, 3)], [('/gyro', 3)]),
        # The skipped number was that of a repetition, since no stamp is skipped.
        ([('gyro', 1004, 3)], []),
        # A second message with the stamp: a repetition by the same publisher has the next number, a
        # message by another publisher a number of its own sequence.
        ([('gyro', 1000, 2), ('gyro', 1004, 3)], []),
        ([('gyro', 1000, 900), ('gyro', 1004, 2)], []),
        ([('gyro', 1000, 1), ('gyro', 1004, 2)], []),
        # A restarted driver counts from the beginning.
        ([('gyro', 1004, 1), ('gyro', 1008, 2)], []),
        ([('gyro', 1000, 1), ('gyro', 1000, 2), ('gyro', 1000, 3), ('gyro', 1004, 4)], []),
        ([('state', 0, 5), ('state', 0, 9)], [('/operating_state', 9)]),
        ([('joy', 0, 5), ('joy', 0, 9)], []),
    ],
)
def test_a_gap_in_the_sequence_numbers_of_a_publisher_is_a_lost_message(events, lost):
    file = File()
    file.tick(1000)
    for name, stamp, number in events:
        file.take(file.clock, max(stamp, 1000))
        file.take(getattr(file, name), stamp, sequence=number)
    assert file.lost == lost


@pytest.mark.parametrize(('takes_part', 'is_lockstep'), [(False, True), (True, False)])
def test_if_stamps_may_be_skipped_every_sequence_number_counts(takes_part, is_lockstep):
    file = File()
    file.gate.takes_part, file.gate.is_lockstep = takes_part, is_lockstep
    file.tick(1000)
    file.take(file.clock, 1008)
    file.take(file.gyro, 1008, sequence=2)
    assert file.lost == []
    file.take(file.clock, 1012)
    file.take(file.gyro, 1012, sequence=4)
    assert file.lost == [('/gyro', 4)]


@pytest.mark.parametrize(
    ('stamps_ms', 'sonar_ms', 'lost'),
    [
        ((1000, 1004, 1008), (1000, 1020), []),
        ((1000, 1008), (1000,), [('/gyro', 1)]),
        ((1000, 1004), (1000, 1040), [('/sonar', 1)]),
        # Stamps before a topic's first sample do not count as lost.
        ((1400, 1404), (1420,), []),
    ],
)
def test_a_skipped_stamp_is_a_lost_message_for_any_next_sender(stamps_ms, sonar_ms, lost):
    file = File()
    for now in range(1000, 1500, 4):
        file.take(file.clock, now)
    for now in stamps_ms:
        file.take(file.gyro, now, sequence=1)
    for now in sonar_ms:
        file.take(file.sonar, now, sequence=1)
    assert file.lost == lost
    # The jump between runs is no gap.
    file.begin('2 abc', 2000 * MS)
    file.tick(2000)
    file.tick(2004)
    assert file.lost == lost


def test_a_restarted_driver_whose_numbers_continue_those_of_the_dead_one_loses_nothing_silently():
    """The recorder has one sample of the first driver, and has missed one of its successor."""
    file = File()
    file.tick(1000)
    for now in range(1004, 1044, 4):
        file.take(file.clock, now)
    file.take(file.sonar, 1040, sequence=2)
    assert file.lost == [('/sonar', 2)]


def test_samples_of_an_earlier_plant_that_arrive_late_fail_the_run_of_the_next():
    """They were on their way to a recorder that has been suspended meanwhile."""
    file = File()
    file.tick(1000)
    file.begin('1 next', START)
    for now in (1008, 1012):
        file.tick(now)
    assert file.objections == []
    file.tick(1000)
    assert file.objections == [('/clock', 1000)]
    file.gate.takes_part = False  # in contrast, a player may go back
    file.take(file.clock, 1004)
    assert file.objections == [('/clock', 1000)]


@pytest.mark.parametrize('crowded', [True, False])
def test_numbers_count_in_free_running_if_there_is_no_stranger(crowded):
    file = File()
    file.gate.is_lockstep = False
    file.tick(1000)
    file.crowded = {'/gyro'} if crowded else set()
    file.take(file.clock, 1004)
    file.take(file.gyro, 1004, sequence=8)
    assert file.lost == ([] if crowded else [('/gyro', 8)])


def test_strangers_on_a_topic_of_events_are_no_lost_messages():
    file = File()
    file.tick(1000)
    file.crowded = {'/operating_state'}
    for number in (3, 700, 4, 701):
        file.take(file.state, 0, sequence=number)
    assert file.lost == []
    assert len(file.of('/operating_state')) == 4


@pytest.mark.parametrize(
    ('numbers', 'lost'),
    [
        # A second plant has reported its end and left before the first one reports its own.
        ((1, 2, 1, 3), []),
        ((1, 2, 1, 4), [4]),
        ((1, 2, 3, 1, 2, 4, 3, 5), []),
        ((1, 2, 3, 1, 2, 4, 3, 6), [6]),
        ((1, 2, 3, 1, 2, 4, 4), [4]),
        # A recorder that starts late has missed the first messages.
        ((7, 8, 1, 9, 2), []),
        # The loss is found after any number of restarts.
        ((*range(40, 0, -1), 2, 3, 12), [12]),
    ],
)
def test_sequence_numbers_belong_to_their_publisher(numbers, lost):
    file = File()
    file.tick(1000)
    for number in numbers:
        file.take(file.state, 0, sequence=number)
    assert file.lost == [('/operating_state', number) for number in lost]


def test_the_next_run_of_a_plant_begins_while_the_last_messages_of_the_previous_one_still_pass():
    file = File()
    file.tick(1000)
    file.take(file.clock, 1004)
    assert file.begin('2 abc', 1100 * MS) is False
    file.take(file.gyro, 1004)
    file.tick(1100)
    assert [stamp for stamp, _ in file.of('/gyro')] == [1000, 1004, 1100]
    assert file.lost == []


def test_another_plant_begins_again_at_an_earlier_time():
    file = File()
    for now in range(1000, 1040, 4):
        file.tick(now)
    assert file.begin('1 def', START) is True
    file.take(file.gyro, 1036, b'left')
    for stream in file.streams:
        file.numbers[stream] = 0
    for now in (1000, 1004):
        file.tick(now)
    assert [stamp for stamp, _ in file.of('/gyro')] == [*range(1000, 1040, 4), 1000, 1004]
    assert file.objections == file.lost == []


def test_without_a_run_everything_passes_in_its_order():
    file = File(run=None)
    file.take(file.state, 0, b'early')
    for now in (500, 504, 400, 508):
        file.tick(now)
    assert file.of('/operating_state') == [(500, b'early')]
    assert [stamp for stamp, _ in file.of('/gyro')] == [500, 504, 508]


def test_without_a_run_any_clock_may_jump():
    file = File(run=None)
    file.crowded = {'/clock'}
    file.tick(500)
    file.tick(500_000)
    assert [stamp for stamp, _ in file.of('/clock')] == [500, 500_000]
    assert file.objections == []


@pytest.mark.parametrize(('copy', 'following'), [(2, 3), (100, 2)], ids=['own', "a stranger's"])
def test_a_copy_of_a_sample_is_counted_only_if_its_sender_may_have_sent_it(copy, following):
    file = File()
    file.gate.takes_part = False
    file.tick(1000)
    file.take(file.gyro, 1000, sequence=copy)
    for now in (1004, 1008):
        file.take(file.clock, now)
    file.take(file.gyro, 1008, sequence=following)
    assert file.lost == []


def test_without_a_run_a_sample_does_not_wait_for_a_clock_that_may_be_anothers():
    file = File(run=None)
    file.tick(500)
    file.take(file.gyro, 504)
    assert file.of('/gyro') == [(500, b'true'), (504, b'true')]


def test_a_players_sample_may_overtake_the_jump_of_its_clock():
    file = File(run=None)
    file.tick(500)
    file.take(file.gyro, 3000)
    file.take(file.clock, 3000)
    file.tick(3004)
    assert len(file.of('/gyro')) == 3
    assert file.lost == file.objections == []


def test_nothing_passes_or_is_lost_until_the_run_of_a_plant_is_known():
    file = File(run=None)
    file.gate.awaits_run = True
    file.take(file.gyro, 5000, b'left')
    for now in (1000, 1004):
        file.tick(now)
    assert file.kept == []
    file.begin('1 abc', START)
    file.tick(1008)
    assert file.of('/gyro') == [(now, b'true') for now in (1000, 1004, 1008)]
    assert file.gyro.complete_ns == 1008 * MS


def test_a_recorder_that_joins_in_mid_run_has_each_tick_once():
    file = File(run=None)
    file.gate.awaits_run = True
    for now in (1400, 1404):
        file.tick(now)
    file.begin('1 abc', START)
    file.tick(1404)
    assert [stamp for stamp, _ in file.of('/gyro')] == [1400, 1404]
    assert file.clock.complete_ns == 1404 * MS


def test_messages_waiting_for_the_clock_of_a_dead_plant_do_not_reach_the_next_one():
    file = File()
    file.tick(1000)
    file.take(file.gyro, 1004, b'of the dead plant')
    file.begin('1 def', START)
    for stream in file.streams:
        file.numbers[stream] = 0
    for now in (1000, 1004):
        file.tick(now)
    assert b'of the dead plant' not in [data for _, data in file.of('/gyro')]
    assert file.objections == []


def test_in_free_running_mode_a_second_sample_of_a_stamp_is_omitted():
    file = File()
    file.gate.is_lockstep = False
    file.tick(1000)
    file.take(file.gyro, 1000, b'another')
    assert file.of('/gyro') == [(1000, b'true')]
    assert file.objections == []


@pytest.mark.parametrize('stamp_ms', [-5000, 400, WALL_NS // MS])
def test_an_event_of_another_clock_is_logged_with_the_time_of_the_run(stamp_ms):
    file = File()
    file.tick(1000)
    file.take(file.state, stamp_ms, b'x')
    assert file.of('/operating_state') == [(1000, b'x')]


def test_an_event_may_be_announced_before_it_happens():
    file = File()
    file.tick(1000)
    file.take(file.state, 8000, b'push')
    assert file.of('/operating_state') == [(8000, b'push')]


def test_all_samples_of_the_run_are_recorded_in_order_despite_strangers():
    for seed in range(30):
        chance = random.Random(seed)
        file = File()
        for now in range(1000, 1400, 4):
            for stream in (file.clock, file.gyro):
                if chance.random() < 0.2:
                    stamp = chance.choice([0, now - 4, now, now + 4, now + 400, WALL_NS // MS])
                    file.take(file.gyro, stamp, b'false', sequence=chance.randrange(1000))
                file.take(stream, now)
        own = [stamp for stamp, data in file.of('/gyro') if data == b'true']
        assert own == list(range(1000, 1400, 4)), seed
        assert all(stamp <= 1400 + 400 for stamp, _ in file.of('/gyro')), seed
