"""The OSEK schedule."""

from ballbot_ros.robot.brick.schedule import Schedule, TaskTiming

CONTROLLER = Schedule(
    TaskTiming(*row)
    for row in (('ts3', 2, 100), ('init', 5, 0), ('ts1', 4, 4), ('lcd', 1, 500), ('ts2', 3, 20))
)


def test_all_alarms_are_in_phase_and_the_most_urgent_task_comes_first():
    assert CONTROLLER.due(0) == ['init', 'ts1', 'ts2', 'ts3', 'lcd']


def test_every_task_comes_once_a_period():
    names = [name for elapsed_ms in range(0, 1000, 4) for name in CONTROLLER.due(elapsed_ms)]
    counts = {task.name: names.count(task.name) for task in CONTROLLER.tasks}
    assert counts == {'init': 1, 'ts1': 250, 'ts2': 50, 'ts3': 10, 'lcd': 2}


def test_a_task_is_due_at_the_multiples_of_its_period_only():
    for elapsed_ms in range(0, 2000, 4):
        expected = [
            name
            for name, period in (('ts1', 4), ('ts2', 20), ('ts3', 100), ('lcd', 500))
            if elapsed_ms % period == 0
        ]
        assert CONTROLLER.due(elapsed_ms) == (['init', *expected] if elapsed_ms == 0 else expected)


def test_tasks_of_one_priority_come_in_the_order_given():
    schedule = Schedule([TaskTiming('first', 1, 4), TaskTiming('second', 1, 4)])
    assert schedule.due(4) == ['first', 'second']
