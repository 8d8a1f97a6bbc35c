"""The OSEK schedule."""

from ballbot_ros.brick.schedule import Schedule, Task


def make_schedule(*rows):
    """Return a schedule of (name, priority, period), and the list of what ran."""
    ran = []
    tasks = [
        Task(name, priority, period, lambda n=name: ran.append(n))
        for name, priority, period in rows
    ]
    return Schedule(tasks), ran


CONTROLLER = [('ts3', 2, 100), ('init', 5, 0), ('ts1', 4, 4), ('lcd', 1, 500), ('ts2', 3, 20)]


def test_all_alarms_are_in_phase_and_the_most_urgent_task_runs_first():
    schedule, ran = make_schedule(*CONTROLLER)
    schedule.run(0)
    assert ran == ['init', 'ts1', 'ts2', 'ts3', 'lcd']


def test_every_task_comes_once_a_period():
    schedule, ran = make_schedule(*CONTROLLER)
    for elapsed_ms in range(0, 1000, 4):
        schedule.run(elapsed_ms)
    counts = {name: ran.count(name) for name, _, _ in CONTROLLER}
    assert counts == {'init': 1, 'ts1': 250, 'ts2': 50, 'ts3': 10, 'lcd': 2}


def test_a_task_is_due_at_the_multiples_of_its_period_only():
    schedule, _ = make_schedule(*CONTROLLER)
    for elapsed_ms in range(0, 2000, 4):
        due = [task.name for task in schedule.due(elapsed_ms)]
        expected = [
            name
            for name, period in (('ts1', 4), ('ts2', 20), ('ts3', 100), ('lcd', 500))
            if elapsed_ms % period == 0
        ]
        assert due == (['init', *expected] if elapsed_ms == 0 else expected)


def test_what_is_due_does_not_depend_on_what_ran():
    schedule, _ = make_schedule(*CONTROLLER)
    assert [task.name for task in schedule.due(100)] == ['ts1', 'ts2', 'ts3']
    assert [task.name for task in schedule.due(100)] == ['ts1', 'ts2', 'ts3']


def test_tasks_of_one_priority_run_in_the_order_given():
    schedule, ran = make_schedule(('first', 1, 4), ('second', 1, 4))
    schedule.run(4)
    assert ran == ['first', 'second']
