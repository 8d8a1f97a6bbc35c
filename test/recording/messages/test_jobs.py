"""``brick/tasks``: its layout, and that it tells of every job of a run."""

from collections import Counter

import numpy as np
import pytest
from parts import make_loop

from ballbot_ros.parameters import ParameterSet
from ballbot_ros.recording.messages.jobs import COLUMNS, Jobs, encode_jobs, jobs_in
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.run_messages import RunMessages
from ballbot_ros.recording.messages.topics import BRICK_TASKS
from ballbot_ros.robot.brick.kernel import Job

TASKS = ['task_ts1', 'task_lcd']
DONE = [
    Job('task_lcd', 1_000_000, 1_000_100, 1_002_000, 300),
    Job('task_ts1', 2**40, 2**40, 2**40, is_lost=True),
]
decode = decoder(BRICK_TASKS.type_name)


def jobs_of(columns):
    """Return columns of jobs as a list."""
    rows = zip(*(each.tolist() for each in columns[1:]), strict=True)
    return [Job(columns.tasks[task], *others) for task, *others in rows]


def test_the_layout_names_tasks_and_columns():
    message = decode(encode_jobs(DONE, TASKS))
    dimensions = [(each.label, each.size, each.stride) for each in message.layout.dim]
    assert dimensions == [
        ('task_ts1,task_lcd', 2, 12),
        ('task,release_us,start_us,end_us,preempted_us,is_lost', 6, 6),
    ]
    assert message.layout.data_offset == 0
    assert message.data.tolist() == [
        1, 1_000_000, 1_000_100, 1_002_000, 300, 0,
        0, 2**40, 2**40, 2**40, 0, 1,
    ]  # fmt: skip


def test_jobs_come_back_the_same():
    for jobs in (DONE, DONE[:1], []):
        found = jobs_in(decode(encode_jobs(jobs, TASKS)))
        assert found.tasks == ('task_ts1', 'task_lcd')
        assert jobs_of(found) == jobs
        assert [each.dtype for each in found[1:]] == [np.int64] * 5 + [np.bool_]


def test_parts_with_other_tasks_are_joined():
    others = [Job('tick', 5, 6, 7)]
    parts = [(DONE, TASKS), (others, ['tick']), (DONE, TASKS[::-1])]
    joined = Jobs.joined([jobs_in(decode(encode_jobs(*part))) for part in parts])
    assert joined.tasks == ('task_ts1', 'task_lcd', 'tick')
    assert jobs_of(joined) == [*DONE, *others, *DONE]


@pytest.mark.parametrize(
    'break_it',
    [
        lambda message: message.layout.dim.pop(),
        lambda message: setattr(message.layout.dim[1], 'label', ','.join(COLUMNS[::-1])),
        lambda message: setattr(message, 'data', message.data[:-1]),
        lambda message: setattr(message.layout.dim[0], 'label', 'task_ts1'),
        lambda message: message.data.__setitem__(0, -1),
    ],
)
def test_a_message_of_something_else_is_refused(break_it):
    message = decode(encode_jobs(DONE, TASKS))
    message.data = message.data.copy()
    break_it(message)
    with pytest.raises(ValueError, match=r'dimensions|task has no name|reshape'):
        jobs_in(message)


def sent_by(loop, ticks):
    """Return the messages of a run with their stamps, and the jobs of its ticks."""
    sent, jobs = [], []

    def make(topic):
        if topic is BRICK_TASKS:
            return lambda stamp_ns, data: sent.append((stamp_ns, jobs_in(decode(data))))
        return lambda stamp_ns, data: None

    messages = RunMessages(make, ParameterSet())
    for _ in range(ticks):
        tick = loop.tick()
        messages.tick(tick, loop.program)
        jobs += tick.outputs.jobs
    return sent, jobs


SLOW = {
    'plant_sim.kernel': True, 'plant_sim.link': True, 'controller.control_instructions': 76_000,
    'controller.bus_cycles': 0.0, 'controller.time_variation': 0.4,
}  # fmt: skip


def test_every_alarm_is_a_job_in_order_or_lost():
    loop = make_loop(SLOW)
    sent, jobs = sent_by(loop, 760)  # 3.04 s, the end of which is not sent
    assert [stamp_ns for stamp_ns, _ in sent] == [
        1_096_000_000 + 100_000_000 * number for number in range(30)
    ]
    rest = [job for job in jobs if job.end >= 4_000_000]
    told = jobs_of(Jobs.joined([each for _, each in sent]))
    assert told == jobs[: len(told)]
    assert set(jobs[len(told) :]) == set(rest)
    for stamp_ns, each in sent:
        end_us = (stamp_ns + 4_000_000) // 1000
        assert np.all((each.end < end_us) & (each.end >= end_us - 100_000))
    counts = Counter(job.task for job in told)
    alarms = {'task_init': 1, 'task_ts1': 750, 'task_ts2': 150, 'task_ts3': 30, 'task_lcd': 6}
    missing = {name: count - counts[name] for name, count in alarms.items()}
    assert all(0 <= count <= 1 for count in missing.values()), missing  # the job under way
    assert sum(job.is_lost for job in told) > 30
    assert any(job.preempted for job in told)


def test_tasks_that_take_no_time_are_not_told():
    assert sent_by(make_loop({}), 60) == ([], [])
