"""Studies that tests carry out, and an observer of them."""

from dataclasses import replace

import yaml

from ballbot_ros.lab.studies.execution import LocalWorkers, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.study_data import StudyData


class Observer:
    """Notes what it sees, and calls functions.

    Parameters
    ----------
    first, each : callable, optional
        Called at the first part, and at each part.
    actions : dict of str to callable
        Called at a notice that has the word.
    """

    def __init__(self, first=None, each=None, actions=None):
        self.first, self.each, self.actions = first, each, actions or {}
        self.done, self.runs, self.notices, self.advanced = None, 0, [], 0

    def begin(self, runs, done):
        self.runs, self.done = runs, done

    def advance(self, runs):
        self.advanced += runs

    def part(self, summary):
        first, self.first = self.first, None
        for call in filter(None, (first, self.each)):
            call()

    def notice(self, text):
        self.notices.append(text)
        for word, action in self.actions.items():
            if word in text:
                action()


def write(folder, content):
    path = folder / 'tried.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return path


def carry_out(
    path, output, workers=LocalWorkers, observer=None, *, seed=None, runs_per_part=None, again=False
):
    """Carry out a study; return its results."""
    study = read_study(str(path), seed=seed)
    job = job_of(study, output)
    if runs_per_part:
        job = replace(job, record=replace(job.record, runs_per_part=runs_per_part))
    observer = observer or Observer()
    run_study(job, observer, workers, again=again)
    return StudyData.open(output)
