"""Makes docs/images/ringing.png and own_controller.png, pictures of the README."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import ballbot_ros as bb
from ballbot_ros.parameters.timing import TICK_S

IMAGES = Path(__file__).resolve().parents[1] / 'images'
CURE = {'controller.a_d': 0.975, 'controller.k_f': [-0.22, -11.7, -0.11, -0.05]}
BEFORE, AFTER = '#c2530a', '#2c74be'


def ringing() -> plt.Figure:
    """Draw the spectra of the duty before and after the cure."""
    figure, axes = plt.subplots(figsize=(7.0, 2.6), layout='constrained')
    for parameters, label, colour in (({}, 'as published', BEFORE), (CURE, 'cured', AFTER)):
        run = bb.simulate('stationary', parameters=parameters)
        duty = run.frame()['duty_x_percent'].loc[2.0:].to_numpy()
        frequency, density = welch(duty, 1.0 / TICK_S, nperseg=512)
        axes.semilogy(frequency, np.sqrt(density), color=colour, label=label)
    axes.set(xlabel='frequency [Hz]', ylabel='duty [%/√Hz]', xlim=(0.0, 125.0))
    axes.grid(alpha=0.3)
    axes.legend(loc='upper center', frameon=False)
    return figure


def own_controller() -> plt.Figure:
    """Draw how the new controller and the document's withstand a push."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, '-m', 'ballbot_ros.cli.main', 'new', 'controller', 'my_pid']
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        own = f'{folder}/my_pid/my_pid/controller.py:MyPid'
        runs = [bb.simulate('push', controller=each).frame() for each in ('python', own)]
    figure, axes = plt.subplots(figsize=(7.0, 2.6), layout='constrained')
    labels = ("the document's program", 'MyPid')
    for frame, label, colour in zip(runs, labels, (BEFORE, AFTER), strict=True):
        pitch = frame['pitch_x_deg'].loc[2.5:6.0]
        axes.plot(pitch.index.to_numpy(), pitch.to_numpy(), color=colour, label=label)
    axes.set(xlabel='time [s]', ylabel='body pitch [°]')
    axes.grid(alpha=0.3)
    axes.legend(loc='lower right', frameon=False)
    return figure


if __name__ == '__main__':
    for name, draw in (('ringing', ringing), ('own_controller', own_controller)):
        draw().savefig(IMAGES / f'{name}.png', dpi=150)
