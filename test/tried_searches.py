"""Searches that tests carry out, with very short runs."""

import yaml
from tried_studies import Observer

SHORT_PUSH = {
    'purpose': 'a test',
    'duration': 2.4,
    'profile': 'ideal',
    'pushes': [{'time': 1.2, 'duration': 0.1, 'force': 1.0, 'direction': 'forward'}],
}
STUDY = {
    'purpose': 'a test',
    'scenario': 'short_push.yaml',
    'runs': 48,
    'vary': {
        'push.1.force': {'uniform': [0.5, 4.0]},
        'push.1.direction': {'uniform': [-180.0, 180.0]},
        'plant_sim.plant_model': {'list': ['linear', 'nonlinear']},
        'plant_sim.actuator_delay': {'list': [0, 2]},
        'plant_sim.body_mass': {'uniform': [0.6, 0.75]},
    },
    'properties': {'upright': 'always: abs(pitch_x_deg) < 6'},
    'expectations': {'peak_position_m': {'max': 0.25}},
}
TUNING = {
    'purpose': 'a test',
    'scenario': 'short_push.yaml',
    'runs': 4,
    'candidates': 16,
    'population': 8,
    'unseen': 8,
    'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.75]}},
    'tune': {
        'python': {
            'controller.k_f.2': {'uniform': [-3.0, -1.0]},
            'controller.k_f.4': {'uniform': [-0.4, -0.05]},
        }
    },
    'objective': {'sum': {'peak_pitch_deg': 1.0, 'duty_rms_percent': 0.01}},
}


class Searching(Observer):
    """Notes what it sees of a search; `each` is called at each part, `after` at a generation."""

    def __init__(self, each=None, after=None):
        super().__init__(each=each)
        self.begun, self.generations, self.after = [], [], after

    def begin(self, runs, done):
        super().begin(runs, done)
        self.begun.append(runs)

    def generation(self, text):
        self.generations.append(text)
        if self.after:
            self.after()


def write(folder, content, of_runs=SHORT_PUSH, **changes):
    """Write a scenario, and a study or tuning; return the path of the latter."""
    for name, data in (('short_push', of_runs), ('tried', {**content, **changes})):
        path = folder / f'{name}.yaml'
        path.write_text(yaml.safe_dump(data, sort_keys=False), encoding='utf-8')
    return path


def files_in(folder):
    """Return the contents of the parts in a folder and below, by their paths."""
    return {str(each.relative_to(folder)): each.read_bytes() for each in folder.rglob('*.parquet')}
