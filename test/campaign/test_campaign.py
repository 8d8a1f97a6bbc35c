"""Output and files of the campaign, with simulated trials."""

import pytest
from click.testing import CliRunner
from rich.console import Console

from campaign import campaign as module
from campaign import simulated
from campaign.fault import Verdict

FAULT = 'full disk'


class EndedTrial:
    """A trial that has ended with a given verdict."""

    told = None
    age_s = 7.0
    has_ended = True

    def __init__(self, trial, seed, folder, domains, mounts):
        self.trial, self.folder, self.domains = trial, folder, domains
        folder.mkdir()
        (folder / 'run.stderr').write_text('what was printed')

    def end(self):
        pass

    def verdict(self):
        return 'a [bold] attempt', self.told


@pytest.fixture
def conduct(monkeypatch, tmp_path):
    monkeypatch.setattr(module, 'TrialProcess', EndedTrial)
    monkeypatch.setattr(module, 'own_mounts', lambda: ['with', 'mounts'])
    monkeypatch.setattr(module.tempfile, 'tempdir', str(tmp_path))

    def run(verdict, *words):
        monkeypatch.setattr(EndedTrial, 'told', verdict)
        words = ['--seed', '5', '--output', str(tmp_path / 'kept'), *words]
        done = CliRunner().invoke(module.campaign, words, standalone_mode=False)
        assert done.exception is None, done.output
        return done

    return run


def test_nothing_is_kept_of_a_passed_trial(conduct, tmp_path):
    done = conduct(Verdict((), 2.0, 10.0), '--only', FAULT, '--trial', '3')
    assert done.return_value == 0
    assert 'seed 5' in done.output
    assert f'held  {FAULT}: a [bold] attempt' in done.output
    assert not (tmp_path / 'kept').exists()
    assert not list(tmp_path.glob('ballbot_campaign_*/*'))


def test_a_failed_trial_is_kept_and_can_be_repeated(conduct, tmp_path):
    done = conduct(Verdict(('the [red] reason',), 2.0, 10.0), '--only', FAULT, '--trial', '3')
    assert done.return_value == 1
    assert 'the [red] reason' in done.output
    assert f"scripts/campaign --seed 5 --only '{FAULT}' --trial 3" in done.output
    (kept,) = tmp_path.glob('kept/*/run.stderr')
    assert kept.read_text() == 'what was printed'


def test_a_fault_that_needs_mounts_is_reported_as_impossible_without_them(conduct, monkeypatch):
    monkeypatch.setattr(module, 'own_mounts', list)
    done = conduct(Verdict((), 2.0, 10.0), '--only', FAULT, '--minutes', '0.1')
    assert done.return_value == 0
    assert 'not possible here' in done.output


def test_a_simulated_trial_is_repeated_with_its_events(tmp_path):
    words = ['--simulated', '--seed', '5', '--trial', '3', '--output', str(tmp_path)]
    outputs = {CliRunner().invoke(module.campaign, words).output for _ in range(2)}
    (output,) = outputs
    assert 'held' in output
    assert (tmp_path / 'trial_3.txt').read_text().count('\n') > 100


def test_a_failed_simulated_trial_is_told_with_the_command_that_repeats_it(monkeypatch, capsys):
    results = [
        simulated.Result(0, (), '', 1.0),
        simulated.Result(7, ('reset',), 'passed with [red] duties', 2.0),
    ]
    monkeypatch.setattr(simulated.SimulatedCampaign, '_results', lambda *_: iter([results]))
    conduct = simulated.SimulatedCampaign(5, None, Console(width=100), None)
    conduct.follow(60.0)
    conduct.print_summary()
    output = capsys.readouterr().out
    assert 'passed with [red] duties' in output
    assert '1 of 2 trials held' in output
    assert 'scripts/campaign --simulated --seed 5 --trial 7' in output


def test_simulated_trials_draw_all_faults():
    words = ['--simulated', '--only', FAULT]
    assert CliRunner().invoke(module.campaign, words).exit_code == 2
