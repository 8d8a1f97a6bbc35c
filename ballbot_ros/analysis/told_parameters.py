"""The parameters of each run of a recording, as its participants told them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.parameters import NODES, PATHS, ParameterError, ParameterSet
from ballbot_ros.recording.attachments import MAPS
from ballbot_ros.recording.reader import AttachedFile
from ballbot_ros.simulation.participants import MAP_HASH
from ballbot_ros.world.library import is_file_name


class ToldParameters:
    """Collects the announcements of a recording."""

    def __init__(self) -> None:
        self._runs: dict[str, dict[str, Mapping[str, Any]]] = {}

    def add(self, data: bytes) -> None:
        """Take a message of ``participants``; one that is none tells nothing."""
        try:
            announcement = decode_announcement(data)
        except ValueError:
            return
        participant = announcement.participant
        if participant.role in NODES and participant.parameters:
            roles = self._runs.setdefault(announcement.run, {})
            roles[participant.role] = participant.parameters

    def __contains__(self, run: str) -> bool:
        return run in self._runs

    def of(
        self, run: str, attached: ParameterSet, files: Mapping[str, AttachedFile]
    ) -> ParameterSet:
        """Return the parameters of a run.

        Parameters
        ----------
        run : str
            Its name, as ``plant/run`` has it.
        attached : ParameterSet
            What the recording has attached; what nobody told is as it says.
        files : mapping of str to AttachedFile
            The attachments, among which a map is that was a file.
        """
        parameters = ParameterSet()
        parameters.update(attached)
        for role, values in self._runs.get(run, {}).items():
            for name, value in values.items():
                if name in PATHS and name != 'map':
                    continue  # of no use elsewhere
                if name == 'map' and is_file_name(value):
                    value = _attached_map(files, values.get(MAP_HASH)) or value
                try:
                    parameters.set(role, name, value)
                except ParameterError:
                    continue  # somebody's own controller has parameters of its own
        return parameters


def _attached_map(files: Mapping[str, AttachedFile], sha256: Any) -> str | None:
    for name in MAPS:
        if name in files and hashlib.sha256(files[name].data).hexdigest() == sha256:
            return name
    return None
