"""The participants of a run: tables of events, and random histories of nodes."""

import dataclasses

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from ballbot_ros.lockstep import roster
from ballbot_ros.lockstep.participants import (
    ANSWER_CALLS,
    LEASE_S,
    NAME_S,
    Announcement,
    LocalNode,
    Objection,
    Participant,
    Publisher,
)
from ballbot_ros.lockstep.roster import ReadinessState, Roster

RUN = '1 abc'
START_NS = 1_000_000_000
OWNERS = {
    '/clock': ('plant_sim',),
    'gyro': ('gyro_driver',),
    'sonar': ('sonar_driver',),
    'motor_duty': ('controller',),
    'recorder/ack': ('recorder',),
    'participants': ('plant_sim', 'gyro_driver', 'sonar_driver', 'controller', 'recorder'),
}
TOPICS = {roles[0]: topic for topic, roles in OWNERS.items() if len(roles) == 1}
ROLES = ('gyro_driver', 'sonar_driver', 'controller')
CALL_S = 0.1


def a(role, instance='', node='', **more):
    """Return a participant; equal arguments mean the same one."""
    instance = instance or f'first {role}'
    return Participant(
        role=role,
        node=node or f'/{role}',
        host='here',
        process=len(instance),
        instance=instance,
        implementation=more.get('implementation', 'ours'),
        parameters_sha256=more.get('parameters', '00'),
        parameters=more.get('values', {}),
        guid_prefix=instance.encode().hex(),
        topics=(TOPICS[role],) if role in ROLES else (),
    )


PLANT = a('plant_sim')


class World:
    """Nodes around a roster: living ones answer each roll call, dead ones stay in the graph."""

    def __init__(self, required=ROLES):
        self.roster = Roster(OWNERS)
        self.living, self.graph, self.now_s = {}, {}, 0.0
        self.now_ns = START_NS
        self.roster.gather(RUN, PLANT, required)
        self.appear(PLANT)

    def appear(self, participant, *, name=None):
        """Show a node's publishers in the graph; `name` is '' while it is unknown."""
        name = participant.node if name is None else name
        for topic in (TOPICS[participant.role], 'participants'):
            gid = participant.instance.encode() + b'|' + topic.encode()
            self.graph[gid] = (topic, name)

    def join(self, *participants, run=RUN):
        for participant in participants:
            self.appear(participant)
            self.living[participant.instance] = participant
            self.roster.on_announcement(Announcement(participant, run))
        return self

    def kill(self, *participants):
        for participant in participants:
            del self.living[participant.instance]
        return self

    def vanish(self, *instances):
        """Let the graph forget nodes."""
        for gid in list(self.graph):
            if gid.rpartition(b'|')[0].decode() in instances:
                del self.graph[gid]
        return self

    def stranger(self, topic, name='/talker', instance='stranger'):
        self.graph[f'{instance}|{topic}'.encode()] = (topic, name)
        return self

    def look(self):
        found = {topic: [] for topic in OWNERS}
        for gid, (topic, name) in self.graph.items():
            found[topic].append(Publisher(gid, name))
        self.roster.update_publishers(found, self.now_s)
        return self.roster.readiness(self.now_ns)

    def watch(self, calls=ANSWER_CALLS + 2):
        """Look and call the roll as the plant does, until the result is final; return it."""
        for _ in range(calls):
            standing = self.look()
            if standing.state is not ReadinessState.WAITING:
                return standing
            self.roster.note_roll_call()
            self.now_s += CALL_S
            for participant in self.living.values():
                self.roster.on_announcement(Announcement(participant, RUN))
        return self.look()

    def watch_for(self, seconds):
        return self.watch(round(seconds / CALL_S))

    def begin(self):
        assert self.watch().state is ReadinessState.COMPLETE
        self.roster.confirm()
        self.now_ns += 400_000_000
        return self


def world(*participants):
    return World().join(*(participants or map(a, ROLES)))


def is_refused(standing, *words):
    assert standing.state is ReadinessState.REFUSED, standing
    assert '\n' not in standing.reason
    for word in words:
        assert word in standing.reason
    return True


def test_a_run_is_complete_when_every_role_has_joined_it():
    empty = World()
    for index, role in enumerate(ROLES):
        standing = empty.watch()
        assert standing.state is ReadinessState.WAITING
        assert all(missing in standing.reason for missing in ROLES[index:])
        assert empty.roster.missing() == list(ROLES[index:])
        empty.join(a(role))
    assert empty.watch().state is ReadinessState.COMPLETE
    assert [member.participant.role for member in empty.roster.history] == ['plant_sim', *ROLES]
    assert empty.roster.periodic_topics == ('gyro', 'sonar', 'motor_duty')


def test_the_run_waits_for_each_node_on_this_machine_to_join_or_end():
    gyro, other = a('gyro_driver'), a('gyro_driver', 'another gyro_driver')
    present = {gyro.instance: LocalNode(gyro.role, gyro.process)}
    started = [*present.values(), LocalNode('sonar_driver', 4711)]
    nodes = World(required=['gyro_driver'])
    for joining, awaited in (
        (other, started),
        # A process of another machine may have the same number.
        (dataclasses.replace(a('sonar_driver'), process=4711, host='there'), started),
        (gyro, started[1:]),
        (dataclasses.replace(a('sonar_driver', 'ours'), process=4711), []),
    ):
        nodes.join(joining)
        nodes.roster.update_local_nodes(present, started)
        assert nodes.roster.awaited_nodes() == awaited
    nodes = World(required=['gyro_driver'])
    nodes.roster.update_local_nodes({}, started)
    assert nodes.roster.absent() == ['gyro_driver', 'sonar_driver (process 4711)']
    assert nodes.join(gyro).look().reason == 'waiting for sonar_driver (process 4711)'


def test_a_participant_of_another_run_does_not_count():
    other = World().join(*map(a, ROLES), run='1 of another plant')
    assert other.look().state is ReadinessState.WAITING
    assert other.roster.missing() == list(ROLES)
    assert other.watch().state is ReadinessState.COMPLETE  # with the answers to the roll call


def test_a_node_of_any_name_can_have_a_role():
    assert world(a('gyro_driver', node='/my_gyro'), a('sonar_driver'), a('controller')).begin()


@pytest.mark.parametrize('has_begun', [False, True])
@pytest.mark.parametrize('role', ROLES)
@pytest.mark.parametrize('node', ['', '/second'])
def test_a_second_living_node_of_a_role_is_refused_with_both_names(has_begun, role, node):
    run = world()
    if has_begun:
        run.begin()
    second = a(role, 'the second', node)
    run.join(second)
    standing = run.watch()
    assert is_refused(standing, TOPICS[role], role, str(a(role)), str(second))
    assert 'likewise' not in standing.reason


def test_duplicates_of_all_roles_are_reported_in_one_line():
    run = world().join(*(a(role, f'second {role}') for role in ROLES))
    assert is_refused(run.watch(), 'gyro_driver', 'likewise as sonar_driver, controller')


@pytest.mark.parametrize('role', ROLES[:2])
def test_a_killed_driver_can_be_replaced_while_its_publishers_are_still_in_the_graph(role):
    run = world().begin()
    run.kill(a(role)).join(a(role, 'its successor'))
    assert run.watch().state is ReadinessState.COMPLETE
    *first, last = run.roster.history
    assert (last.participant, last.since_ns, last.is_successor) == (
        a(role, 'its successor'), run.now_ns, True,
    )  # fmt: skip
    assert not any(member.is_successor for member in first)


def test_all_drivers_may_be_replaced_at_once_and_again():
    run = world().begin()
    for generation in ('second', 'third'):
        victims = [each for each in run.living.values() if each.role in ROLES[:2]]
        run.kill(*victims).join(*(a(each.role, f'{generation} {each.role}') for each in victims))
        assert run.watch().state is ReadinessState.COMPLETE


@pytest.mark.parametrize('calls', [1, 2, ANSWER_CALLS - 1])
def test_a_successor_that_has_answered_may_be_replaced_before_the_first_is_found_dead(calls):
    run = world().begin()
    second, third = (a('gyro_driver', f'{generation} gyro_driver') for generation in ('2nd', '3rd'))
    run.kill(a('gyro_driver')).join(second)
    assert run.watch(calls).state is ReadinessState.WAITING
    run.kill(second).join(third)
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.history[-1].participant == third


@pytest.mark.parametrize('change', [{'parameters': '01'}, {'implementation': 'theirs'}])
def test_a_driver_is_not_replaced_by_a_different_one(change):
    run = world().begin()
    run.kill(a('gyro_driver')).join(a('gyro_driver', 'the other', **change))
    assert is_refused(run.watch(), 'replaces', 'other parameters', '/gyro_driver')


def test_a_driver_that_was_given_faults_is_not_replaced_by_one_without_them():
    run = world().begin()
    faulty = dataclasses.replace(a('gyro_driver'), parameters={'faults': 'gyro_x off time=3'})
    run.roster.on_announcement(Announcement(faulty, RUN))
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.members['gyro_driver'].parameters == faulty.parameters
    run.kill(faulty).join(a('gyro_driver', 'the other'))
    assert is_refused(run.watch(), 'replaces', 'other parameters', '/gyro_driver')


@pytest.mark.parametrize('has_begun', [False, True])
def test_two_roles_have_the_same_faults_only_at_the_start(has_begun, monkeypatch):
    run = world()
    monkeypatch.setattr(roster, '_SHARED', {'faults': ('controller', 'gyro_driver')})
    texts = {'controller': 'task_ts1 slow', 'gyro_driver': ''}
    if has_begun:
        run.begin()
    for role, text in texts.items():
        run.roster.on_announcement(Announcement(a(role, values={'faults': text}), RUN))
    standing = run.watch()
    if has_begun:
        assert standing.state is ReadinessState.COMPLETE
    else:
        assert is_refused(standing, "faults is 'task_ts1 slow' in /controller, but '' in")


def test_before_the_run_begins_any_participant_may_be_replaced():
    run = world()
    assert run.watch().state is ReadinessState.COMPLETE
    run.kill(a('gyro_driver')).join(a('gyro_driver', 'the other', parameters='01'))
    assert run.watch().state is ReadinessState.COMPLETE
    instances = [member.participant.instance for member in run.roster.history]
    assert 'the other' in instances
    assert a('gyro_driver').instance not in instances
    assert not any(member.is_successor for member in run.roster.history)


def test_a_restarted_controller_is_a_successor_with_any_parameters():
    run = world().begin()
    run.kill(a('controller')).join(a('controller', 'afresh', parameters='rejoin'))
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.history[-1].is_successor


def test_a_participant_that_returns_after_being_replaced_is_refused():
    run = world().begin()
    asleep = a('gyro_driver')
    run.kill(asleep).join(a('gyro_driver', 'its successor'))
    assert run.watch().state is ReadinessState.COMPLETE
    run.join(asleep)
    assert is_refused(run.watch(), '/gyro_driver', 'gyro')


def test_the_run_waits_for_a_new_node_whose_name_is_not_known_yet():
    run = world().begin()
    run.kill(a('gyro_driver'))
    newcomer = a('gyro_driver', 'its successor')
    run.appear(newcomer, name='')
    assert run.watch().state is ReadinessState.WAITING
    run.living[newcomer.instance] = newcomer
    assert run.watch().state is ReadinessState.COMPLETE


def test_without_a_prefix_a_publisher_is_identified_by_its_node_name():
    plain = [dataclasses.replace(a(role), guid_prefix='') for role in ROLES]
    assert world(*plain).begin().look().state is ReadinessState.COMPLETE


@pytest.mark.parametrize('has_begun', [False, True])
@pytest.mark.parametrize('topic', OWNERS)
def test_a_stranger_that_sends_is_refused_by_name(has_begun, topic):
    run = world()
    if has_begun:
        run.begin()
    run.stranger(topic)
    assert run.look().state is ReadinessState.WAITING
    assert run.roster.suspected_topics == {topic}
    run.roster.note_foreign_message(topic)
    assert is_refused(run.watch(), '/talker', repr(topic))


def test_a_stranger_that_sends_before_its_name_is_known_is_refused_once_it_is():
    run = world().begin().stranger('gyro', name='')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert run.watch().state is ReadinessState.WAITING
    assert is_refused(run.stranger('gyro').watch(), '/talker')


def test_a_stranger_keeps_its_name_if_the_graph_no_longer_tells_it():
    run = world().begin().stranger('gyro')
    run.look()
    run.stranger('gyro', name='')
    run.roster.note_foreign_message('gyro')
    assert is_refused(run.watch(), '/talker')


def test_a_stranger_is_refused_only_after_the_time_in_which_a_new_node_joins():
    run = world().begin().stranger('gyro')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert run.watch(ANSWER_CALLS - 1).state is ReadinessState.WAITING
    assert is_refused(run.watch(1), '/talker')


def test_a_stranger_without_a_name_is_refused_too():
    run = world().begin().stranger('gyro', name='')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert is_refused(run.watch_for(NAME_S + 1.0), 'gyro')


def test_a_stranger_with_the_name_of_a_participant_is_refused():
    run = world().begin().stranger('gyro', name='/gyro_driver')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert is_refused(run.watch(), '/gyro_driver publishes')


@pytest.mark.parametrize('has_begun', [False, True])
def test_a_silent_stranger_is_tolerated_while_it_may_be_a_dead_process(has_begun):
    run = world()
    if has_begun:
        run.begin()
    run.stranger('gyro')
    assert run.watch_for(LEASE_S - 1.0).state is ReadinessState.WAITING
    assert is_refused(run.watch_for(2.0), '/talker', 'gyro')


def test_a_dead_stranger_that_leaves_the_graph_is_no_problem():
    run = World().stranger('gyro')
    # The stranger may have died shortly before the participants join.
    assert run.watch_for(30.0).state is ReadinessState.WAITING
    run.join(*map(a, ROLES))
    assert run.watch_for(LEASE_S - 1.0).state is ReadinessState.WAITING
    assert run.vanish('stranger').watch().state is ReadinessState.COMPLETE


def test_an_objection_names_the_stranger_on_its_topic_and_no_other():
    run = world().begin().stranger('sonar', '/of_the_sonar', 'x').stranger('gyro')
    run.look()
    run.roster.add_objection(Objection('two samples', 'gyro', run.now_ns))
    assert is_refused(run.watch(), '/talker', 'gyro')


def test_an_objection_names_a_stranger_that_has_gone():
    run = world().begin().stranger('gyro')
    run.look()
    run.vanish('stranger')
    run.roster.add_objection(Objection('two samples', 'gyro', run.now_ns))
    assert is_refused(run.watch(), '/talker', 'gyro')


def test_a_stranger_that_left_long_ago_is_not_blamed():
    run = world().begin().stranger('sonar', '/dead_sonar')
    run.watch_for(3.0)
    run.vanish('stranger')
    assert run.watch().state is ReadinessState.COMPLETE
    for _ in range(30):
        run.look()
        run.now_s += CALL_S
    run.roster.add_objection(Objection('two samples', 'gyro', run.now_ns))
    standing = run.watch()
    assert is_refused(standing, 'two samples')
    assert 'dead_sonar' not in standing.reason


def test_the_stranger_is_named_not_a_new_node():
    run = world().begin()
    run.kill(a('gyro_driver'))
    newcomer = a('gyro_driver', 'its successor')
    run.appear(newcomer)
    run.stranger('gyro')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert is_refused(run.watch(), '/talker')


def test_a_stranger_is_still_found_after_a_new_node_was_suspected():
    run = world().begin()
    run.kill(a('gyro_driver'))
    newcomer = a('gyro_driver', 'its successor')
    run.appear(newcomer, name='')
    run.look()
    run.roster.note_foreign_message('gyro')
    run.join(newcomer)
    assert run.watch().state is ReadinessState.COMPLETE
    run.stranger('gyro')
    run.look()
    run.roster.note_foreign_message('gyro')
    assert is_refused(run.watch(), '/talker')


def test_time_without_looks_at_the_graph_does_not_count_against_suspects():
    run = world().begin().stranger('gyro')
    run.look()
    run.now_s += 10 * LEASE_S
    assert run.watch().state is ReadinessState.WAITING
    assert run.vanish('stranger').look().state is ReadinessState.COMPLETE


def test_an_objection_to_a_participant_itself_is_the_reason():
    run = world().begin()
    run.roster.on_announcement(
        Announcement(a('controller'), RUN, 0, Objection('two samples of 1.4 s', 'gyro', run.now_ns))
    )
    assert is_refused(run.watch(), 'two samples of 1.4 s', '/gyro_driver', 'left')


def test_an_objection_waits_until_roll_calls_have_shown_who_is_alive():
    run = world().begin()
    run.roster.add_objection(Objection('two samples', 'gyro', run.now_ns))
    assert run.watch(ANSWER_CALLS - 1).state is not ReadinessState.REFUSED
    assert is_refused(run.watch(), 'two samples')


def test_the_handover_of_a_role_excuses_no_other():
    run = world().begin()
    run.kill(a('gyro_driver')).join(a('gyro_driver', 'its successor'))
    run.watch()
    for topic in ('gyro', 'sonar'):
        run.roster.add_objection(Objection(f'two samples on {topic}', topic, START_NS))
    assert is_refused(run.watch(), 'two samples on sonar')


def test_a_participant_that_can_not_continue_ends_the_run_at_once():
    run = world().begin()
    run.roster.add_objection(Objection('started in mid-run'))
    assert is_refused(run.look(), 'started in mid-run')


def test_a_recorder_that_can_not_continue_ends_only_a_run_that_requires_it():
    full = Announcement(a('recorder'), RUN, 0, Objection('x.mcap: No space left on device'))
    run = World((*ROLES, 'recorder')).join(*map(a, ROLES), a('recorder')).begin()
    run.roster.on_announcement(full)
    assert is_refused(run.look(), 'recorder: x.mcap: No space left on device')
    run = world().join(a('recorder')).begin()
    assert run.roster.reported_failure('recorder') == ''
    run.roster.on_announcement(full)
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.reported_failure('recorder') == 'x.mcap: No space left on device'


def test_a_recorder_that_is_not_required_may_object_to_a_sample():
    run = world().join(a('recorder')).begin()
    objection = Objection.to_sample('gyro', run.now_ns)
    run.roster.on_announcement(Announcement(a('recorder'), RUN, 0, objection))
    assert is_refused(run.watch(), "'gyro' has a second sample stamped 1.400 s")


def test_two_answers_to_the_tick_of_a_handover_are_no_problem():
    run = world().begin()
    run.kill(a('gyro_driver')).join(a('gyro_driver', 'its successor'))
    run.roster.add_objection(Objection.to_sample('gyro', run.now_ns))
    run.roster.add_objection(Objection.to_sample('gyro', run.now_ns - 40_000_000))
    assert run.watch().state is ReadinessState.COMPLETE
    run.roster.add_objection(Objection.to_sample('gyro', run.now_ns + 4_000_000))
    assert is_refused(run.watch(), 'has a second sample')


def test_a_recorder_may_join_leave_and_be_replaced():
    run = world().begin().join(a('recorder'))
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.history[-1].participant == a('recorder')
    run.kill(a('recorder')).join(a('recorder', 'another one', parameters='another file'))
    assert run.watch().state is ReadinessState.COMPLETE


def test_an_impostor_of_a_participant_is_refused():
    run = world().begin()
    forged = dataclasses.replace(a('gyro_driver'), node='/forger', parameters_sha256='ff')
    run.roster.on_announcement(Announcement(forged, RUN))
    assert is_refused(run.look(), '/forger', '/gyro_driver')


def test_a_forged_announcement_without_answers_to_roll_calls_is_ignored():
    run = world().begin()
    run.roster.on_announcement(Announcement(a('gyro_driver', 'forged', '/forger'), RUN))
    assert run.watch().state is ReadinessState.COMPLETE
    assert run.roster.history[-1].participant == a('controller')


@pytest.mark.parametrize(
    ('gyro', 'sonar', 'controller', 'reason'),
    [
        ({'seed': 1}, {'seed': 1}, {}, ''),
        ({'seed': 1, 'noise': 2}, {'seed': 1, 'noise': 3}, {}, ''),
        ({'ball_radius': 0.5}, {}, {'seed': 4}, ''),
        ({'seed': 1}, {'seed': 2}, {}, 'seed is 1 in /gyro_driver, but 2 in /sonar_driver'),
        ({}, {'seed': 1.0}, {'seed': 2.0}, 'seed is 2.0 in /controller, but 1.0 in /sonar'),
        ({'seed': [1]}, {'seed': {'a': 2}}, {}, "but {'a': 2} in /sonar_driver"),
    ],
)
def test_shared_parameters_of_participants_must_be_equal(gyro, sonar, controller, reason):
    values = dict(zip(ROLES, (gyro, sonar, controller), strict=True))
    standing = world(*(a(role, values=values[role]) for role in ROLES)).watch()
    if reason:
        assert is_refused(standing, reason)
    else:
        assert standing.state is ReadinessState.COMPLETE


def test_shared_parameters_of_a_successor_must_be_equal():
    driver, follower = (a('controller', each, values={'seed': n}) for n, each in enumerate('xy'))
    there = world(a('gyro_driver', values={'seed': 0}), a('sonar_driver'), driver).begin()
    assert is_refused(there.kill(driver).join(follower).watch(), 'seed is 1 in /controller')


def test_an_unknown_role_changes_nothing():
    run = world().begin()
    history = run.roster.history
    for instance in ('x', 'y'):
        cook = dataclasses.replace(a('gyro_driver', instance), role='cook')
        run.roster.on_announcement(Announcement(cook, RUN))
    assert run.look().state is ReadinessState.COMPLETE
    assert run.roster.history == history


def test_the_next_run_gathers_all_participants_again_and_remembers_dead_ones():
    run = world().begin()
    run.kill(a('gyro_driver')).join(a('gyro_driver', 'its successor'))
    assert run.watch().state is ReadinessState.COMPLETE
    run.roster.gather('2 abc', PLANT, ROLES)
    assert run.look().state is ReadinessState.WAITING
    for participant in run.living.values():
        run.roster.on_announcement(Announcement(participant, '2 abc'))
    # The publishers of the dead node are still in the graph.
    assert run.look().state is ReadinessState.COMPLETE
    assert not any(member.is_successor for member in run.roster.history)


@pytest.mark.parametrize(
    ('dead', 'answered', 'expected'),
    [
        ({'controller'}, {}, ['controller']),
        ({'gyro_driver', 'controller'}, {}, ['gyro_driver', 'controller']),
        (set(), {'gyro_driver': START_NS}, ['gyro_driver']),
        (set(), dict.fromkeys(ROLES[:2], START_NS), list(ROLES[:2])),
        ({'sonar_driver'}, {'gyro_driver': START_NS}, ['sonar_driver']),
        (set(), {}, []),
    ],
)  # fmt: skip
def test_a_participant_is_silent_without_a_roll_call_answer_or_else_without_the_tick(
    dead, answered, expected
):
    run = world().begin()
    since, due_ns = run.roster.calls, START_NS + 4_000_000
    run.roster.note_roll_call()
    for role in ROLES:
        if role not in dead:
            run.roster.on_announcement(Announcement(a(role), RUN, answered.get(role, due_ns)))
    due = {'gyro_driver': due_ns, 'sonar_driver': due_ns, 'controller': 0}
    silences_s = run.roster.silences_s(since, due, lambda participant: 3.0)
    assert silences_s == dict.fromkeys(expected, 3.0)


def test_each_participant_has_its_own_silence_but_living_ones_may_wait_for_others():
    run = world().begin()
    own_s = {'gyro_driver': 1.0, 'sonar_driver': 2.0, 'controller': 3.0}

    def silences_s():
        due = dict.fromkeys(own_s, START_NS + 4_000_000)
        return run.roster.silences_s(since, due, lambda each: own_s[each.role])

    since = run.roster.calls
    run.roster.note_roll_call()
    assert silences_s() == own_s
    run.roster.on_announcement(Announcement(a('gyro_driver'), RUN))
    assert silences_s() == {'sonar_driver': 2.0, 'controller': 3.0}
    for role in ROLES:
        run.roster.on_announcement(Announcement(a(role), RUN))
    assert silences_s() == dict.fromkeys(own_s, 1.0)


def test_what_a_starved_controller_awaits_may_be_in_its_own_queue():
    run = world().begin()
    since, due_ns = run.roster.calls, START_NS + 4_000_000
    run.roster.note_roll_call()
    for role in ROLES:
        awaits = {'gyro': None} if role == 'controller' else {}
        run.roster.on_announcement(Announcement(a(role), RUN, due_ns, awaits=awaits))
    due = {'gyro_driver': due_ns, 'sonar_driver': due_ns, 'controller': 0}
    for own_s in (0.1, 3.0):
        silences_s = run.roster.silences_s(
            since, due, lambda each, own_s=own_s: own_s if each.role == 'controller' else 2.0
        )
        assert silences_s == {'gyro_driver': min(own_s, 2.0)}


def test_an_answer_to_an_earlier_roll_call_does_not_end_this_silence():
    run = world().begin()
    run.roster.note_roll_call()
    run.roster.on_announcement(Announcement(a('controller'), RUN))
    since = run.roster.calls
    assert run.roster.silences_s(since, {'controller': 0}, lambda each: 1.0) == {'controller': 1.0}


class AnyHistory(RuleBasedStateMachine):
    """Nodes that start, die and return in any order.

    After some time a run continues if and only if each role has one living participant, equal to
    the one at the start, and there is no stranger.
    """

    @initialize()
    def start(self):
        self.world = world().begin()
        self.number = 0
        self.refusable = False
        self.strangers = set()

    def new(self, role, **more):
        self.number += 1
        return a(role, f'number {self.number}', **more)

    def of(self, role):
        return [each for each in self.world.living.values() if each.role == role]

    @rule(role=st.sampled_from(ROLES[:2]))
    def kill(self, role):
        self.world.kill(*self.of(role))

    @rule(role=st.sampled_from(ROLES[:2]))
    def restart(self, role):
        if not self.of(role):
            self.world.join(self.new(role))

    @rule(role=st.sampled_from(ROLES))
    def double(self, role):
        self.refusable = self.refusable or bool(self.of(role))
        if self.of(role):
            self.world.join(self.new(role))

    @rule(topic=st.sampled_from(list(OWNERS)), is_heard=st.booleans())
    def stranger_appears(self, topic, is_heard):
        self.world.stranger(topic, instance=f'stranger {topic}')
        self.strangers.add(topic)
        self.world.look()
        if is_heard:
            self.refusable = True
            self.world.roster.note_foreign_message(topic)

    @precondition(lambda self: self.strangers)
    @rule()
    def strangers_leave(self):
        self.world.vanish(*(f'stranger {topic}' for topic in self.strangers))
        self.strangers.clear()

    @rule()
    def time_passes(self):
        standing = self.world.watch()
        if standing.state is ReadinessState.REFUSED:
            assert self.refusable, standing
            self.start()
        elif standing.state is ReadinessState.COMPLETE:
            assert not self.strangers
            for role in ROLES:
                assert len(self.of(role)) <= 1, role

    @invariant()
    def no_instance_joins_twice(self):
        members = self.world.roster.history if hasattr(self, 'world') else ()
        assert len({member.participant.instance for member in members}) == len(members)

    def teardown(self):
        if hasattr(self, 'world'):
            standing = self.world.watch_for(LEASE_S + 2.0)
            doubled = any(len(self.of(role)) > 1 for role in ROLES)
            if doubled or self.strangers:
                assert standing.state is ReadinessState.REFUSED
            elif standing.state is ReadinessState.REFUSED:
                assert self.refusable


TestAnyHistory = AnyHistory.TestCase
TestAnyHistory.settings = settings(max_examples=150, stateful_step_count=15, deadline=None)
