"""Runs of a study once more, without its results."""

from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.rerun import rerun_spec
from ballbot_ros.lab.studies.study_data import RunResults
from ballbot_ros.lab.studies.variables import SEED
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters.files import plain_value
from ballbot_ros.run.requirements import Processes


def rerun_of(study, samples, run, folder, controller=None):
    """Return the specification of a run of some samples; its files are in a new folder."""
    columns = {**samples.values, **samples.events}
    values = {name: plain_value(column[run]) for name, column in columns.items()}
    seed = values.pop(SEED, study.spec.plant.seed)
    row = RunResults(run, seed, values, {}, True, Outcome.COMPLETED, False, 0, '')
    record = job_of(study, folder).record
    return rerun_spec(record, row, folder / 'again', Processes.NONE, controller)
