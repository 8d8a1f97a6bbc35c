"""A run to look at: its verdict, metrics, signals and figure."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ballbot_ros.analysis.assessment import ExpectationResult, PropertyResult, assess
from ballbot_ros.analysis.drawing import draw_motion
from ballbot_ros.analysis.figure_parts import IntervalKind, png_of
from ballbot_ros.analysis.metrics import Verdict, with_judgements
from ballbot_ros.analysis.page import render_template
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.report import banner, metric_text
from ballbot_ros.analysis.run_data import RunData, read_run
from ballbot_ros.analysis.signals import frame_of
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import replacing
from ballbot_ros.parameters import DOCUMENTS_PROGRAM
from ballbot_ros.recording.messages.recording_files import open_recording

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

_SUFFIX = '.mcap'
_PIXELS_PER_INCH = 96


class Run:
    """A simulated or recorded run.

    :func:`ballbot_ros.simulate` and :func:`ballbot_ros.open` return it. In a notebook, it shows its
    metrics and its figure.

    Parameters
    ----------
    data : RunData
        What was read from its recording.
    recording : bytes or Path
        The recording: its content, or its file.
    earlier : Run or None
        The run of which it is a branch. None to look for it next to the file.
    """

    def __init__(self, data: RunData, recording: bytes | Path, earlier: Run | None = None) -> None:
        self._assessment = assess(data)
        self._data = self._assessment.run
        self._recording = recording
        self._earlier = earlier
        for array in vars(data.trajectory).values():
            array.flags.writeable = False

    def __repr__(self) -> str:
        """Return name and verdict."""
        reason = f': {self.reason}' if self.reason else ''
        return f'<Run {self.name}, {self.verdict}{reason}>'

    @property
    def name(self) -> str:
        """Name of the scenario or the recording."""
        return self._data.name

    @property
    def earlier(self) -> Run | None:
        """The run of which this is a branch; None if it is none, or its file is not near."""
        if self._earlier is None and isinstance(self._recording, Path):
            parent = Parent.decode(self._data.attached.files)
            if parent and (found := parent.find(self._recording)):
                self._earlier = Run(read_run(found, parent.run), found)
        return self._earlier

    @property
    def passed(self) -> bool:
        """Whether the run is complete, and all expectations and properties are met."""
        return self.verdict is Verdict.PASSED

    @property
    def verdict(self) -> Verdict:
        """The result in one word."""
        return self._assessment.outcome

    @property
    def reason(self) -> str:
        """Why the run did not pass, on one line; empty if it passed."""
        return self._assessment.reason

    @property
    def metrics(self) -> Mapping[str, float]:
        """The value of each metric, by name; NaN if the data are missing.

        The names end in the unit. The page on reports has their meanings.
        """
        return dict(self._assessment.metrics)

    @property
    def expectations(self) -> tuple[ExpectationResult, ...]:
        """The expectations of the scenario, with the measured values and verdicts."""
        return self._assessment.expectations

    @property
    def properties(self) -> tuple[PropertyResult, ...]:
        """The properties of the scenario, with their robustness and verdicts."""
        return self._assessment.properties

    @property
    def trajectory(self) -> Trajectory:
        """True position and body pitch, and duty, as constant arrays; none of a real robot."""
        return self._data.trajectory

    @property
    def duty_sha256(self) -> str | None:
        """SHA-256 of all int8 duty pairs, which identifies the run.

        None if ticks are missing in the recording, or the run was not in lockstep.
        """
        return self._data.duty_sha256

    def frame(self) -> pandas.DataFrame:
        """Return all signals as a data frame, one row per tick of 4 ms.

        The index `time_s` is the time since the start [s]. The columns, each for the planes ``x``
        and ``y``:

        ============================ ============================================================
        ``position_x_m``             true position of the ball
        ``pitch_x_deg``              true body pitch
        ``pitch_rate_x_deg_per_s``   its rate
        ``motor_rate_x_deg_per_s``   true rate of the motor
        ``motor_torque_x_n_m``       true torque of the motor
        ``duty_x_percent``           duty
        ``gyro_x_deg_per_s``         reading of the gyro, with its offset
        ``encoder_x_deg``            reading of the encoder
        ``estimated_position_x_m``   estimate of the controller, NaN while it is not in control
        ``estimated_pitch_x_deg``    estimate of the controller, NaN while it is not in control
        ============================ ============================================================

        ``distance_m`` (infinite without an echo), ``battery_v`` and ``operating_state`` are the
        same for both planes. Distance and battery voltage keep their newest value. A signal that
        was not recorded has no column.

        Raises
        ------
        BallbotError
            If pandas is not installed.
        """
        return frame_of(self._data)

    def plot(self) -> Figure:
        """Return a figure of position, body pitch and duty against time.

        If the ball moves in both planes, or has a map, the track is next to them. A notebook shows
        the figure; in a program, ``run.plot().savefig('run.png')`` writes it. The earlier run of a
        branch has thin curves.
        """
        run, scenario = self._data, self._data.attached.scenario
        controller = run.attached.controller.rpartition(':')[2]
        name = '' if controller in ('', *DOCUMENTS_PROGRAM) else f', {controller}'
        if run.is_real:
            name = ', real robot (estimated)'
        purpose = f': {scenario.purpose}' if scenario else ''
        return draw_motion(
            run.motion,
            f'{run.name}{name}{purpose}',
            run.plant.hold_time,
            scenario.segments if scenario else (),
            run.floor,
            [each for each in run.marked if each.kind is not IntervalKind.STATE],
            self.earlier._data.motion if self.earlier else None,
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the recording to a file, which replaces an existing one.

        It is the file that the node graph writes: ``ballbot`` and other ROS 2 tools read it.

        Parameters
        ----------
        path : str or path-like
            Its name ends in ``.mcap``.

        Raises
        ------
        BallbotError
            If it has another ending, or can't be written.
        """
        target = Path(path)
        if target.suffix != _SUFFIX:
            raise BallbotError(f'{target}: the name of a recording ends in {_SUFFIX}')
        content = self._recording
        if isinstance(content, Path):
            with open_recording(content) as reader:
                content = reader.contents()
        with replacing(target) as unfinished:
            unfinished.write_bytes(content)
        return target

    def _repr_html_(self) -> str:
        verdicts = {each.judgement: each.verdict for each in self.expectations}
        rows = [
            (name, metric_text(name, value).value, judgement, judgement and verdicts[judgement])
            for name, value, judgement in with_judgements(self.metrics, verdicts)
            if judgement or not math.isnan(value)
        ]
        figure = self.plot()
        return render_template(
            'run.html',
            run=self,
            banner=banner(self._data),
            motion=[row for row in rows if row[0] in METRICS],
            others=[row for row in rows if row[0] not in METRICS],
            figure=png_of(figure),
            width=round(figure.get_figwidth() * _PIXELS_PER_INCH),
        )
