"""What the plant reports in its diagnostics, for those who show or watch it."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.messages.participation import OK
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import DIAGNOSTICS
from ballbot_ros.parameters import PLANT

_decode = decoder(DIAGNOSTICS.type_name)


@dataclass(frozen=True)
class PlantReport:
    """State of the plant and of its run.

    Attributes
    ----------
    run : str
        Name of the run in ``plant/run``; '' before the first.
    awaits_start : bool
        Whether the run is paused because it starts paused.
    pace : float
        Required sim time per wall time; 0: as fast as possible.
    missing : tuple of str
        The roles that the run waits for before its first tick.
    outcome : str
        How the run has ended; '' while it lasts.
    problem : str
        The current warning or error, or ''.
    """

    run: str = ''
    is_paused: bool = False
    awaits_start: bool = False
    pace: float = 1.0
    missing: tuple[str, ...] = ()
    outcome: str = ''
    problem: str = ''


def decode_plant_report(data: bytes) -> PlantReport | None:
    """Decode a message of ``/diagnostics``; None if it is not the plant's.

    Only a message that can be the plant's is decoded: all nodes publish on this topic.
    """
    if PLANT.encode() not in data:
        return None
    try:
        message = _decode(data)
    except ValueError:
        return None
    for status in message.status:
        values = {pair.key: pair.value for pair in status.values}
        if values.get('role') == PLANT:
            return _report(values, '' if status.level == OK else status.message)
    return None


def _report(values: dict[str, str], problem: str) -> PlantReport:
    return PlantReport(
        run=values.get('run name', ''),
        is_paused=values.get('paused') == str(True),
        awaits_start=values.get('awaits start') == str(True),
        pace=_number(values.get('pace', '')),
        missing=tuple(values.get('missing', '').split()),
        outcome=values.get('outcome', ''),
        problem=problem,
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return PlantReport.pace
