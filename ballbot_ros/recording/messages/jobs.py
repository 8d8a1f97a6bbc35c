"""The jobs of the brick in ``brick/tasks``.

Docs/protocol.md describes the layout of the message.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.recording.messages.topics import BRICK_TASKS
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.brick.kernel import Job

COLUMNS = ('task', 'release_us', 'start_us', 'end_us', 'preempted_us', 'is_lost')


class Jobs(NamedTuple):
    """Jobs in the order in which they ended, as columns of shape (n,); times [µs] as in Job.

    `task` has the number of each job's task in `tasks`.
    """

    tasks: tuple[str, ...]
    task: NDArray[np.int64]
    release: NDArray[np.int64]
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    preempted: NDArray[np.int64]
    is_lost: NDArray[np.bool_]

    def selected(self, rows: NDArray[np.bool_]) -> Jobs:
        """Return the jobs of a mask, shape (n,)."""
        columns = {name: values[rows] for name, values in self._asdict().items() if name != 'tasks'}
        return self._replace(**columns)

    @classmethod
    def joined(cls, parts: Sequence[Jobs]) -> Jobs:
        """Return the jobs of all parts, whose tasks may differ; there is at least one."""
        tasks = tuple(dict.fromkeys(name for part in parts for name in part.tasks))
        task = [np.array([*map(tasks.index, part.tasks)])[part.task] for part in parts]
        _, _, *others = zip(*parts, strict=True)
        return cls(tasks, *map(np.concatenate, (task, *others)))


def encode_jobs(jobs: Sequence[Job], tasks: Sequence[str]) -> bytes:
    """Return ``brick/tasks`` with the jobs of a program that has these tasks."""
    message, width = new_message(BRICK_TASKS.type_name), len(COLUMNS)
    message.layout.dim = [
        _dimension(tasks, len(jobs), len(jobs) * width),
        _dimension(COLUMNS, width, width),
    ]
    message.data = [number for job in jobs for number in (tasks.index(job.task), *job[1:])]
    return encoder(BRICK_TASKS.type_name)(message)


def _dimension(names: Sequence[str], size: int, stride: int) -> Any:
    dimension = new_message('std_msgs/msg/MultiArrayDimension')
    dimension.label, dimension.size, dimension.stride = ','.join(names), size, stride
    return dimension


def jobs_in(message: Any) -> Jobs:
    """Return the jobs in ``brick/tasks``; ValueError if it is malformed."""
    labels = [each.label for each in message.layout.dim]
    if len(labels) != 2 or labels[1] != ','.join(COLUMNS):
        raise ValueError(f'its dimensions {labels} are not those of jobs')
    tasks = tuple(labels[0].split(','))
    numbers = np.reshape(message.data, (-1, len(COLUMNS)))
    task, release, start, end, preempted, is_lost = numbers.T
    if not np.all((task >= 0) & (task < len(tasks))):
        raise ValueError(f'a task has no name in {labels[0]}')
    return Jobs(tasks, task, release, start, end, preempted, is_lost > 0)
