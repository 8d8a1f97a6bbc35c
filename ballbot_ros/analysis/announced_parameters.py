"""The parameters of each run of a recording, as its participants announced them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from ballbot_ros.messages.participation import decode_announcement, decode_run_status
from ballbot_ros.messages.topics import RUN_STATUS, Topic
from ballbot_ros.parameters import (
    NODES,
    PATHS,
    PLANT,
    ROLES,
    SIMULATED,
    ParameterError,
    ParameterSet,
)
from ballbot_ros.recording.attachments import MAPS
from ballbot_ros.recording.reader import AttachedFile
from ballbot_ros.simulation.participants import MAP_HASH, Participant
from ballbot_ros.world.library import is_file_name


class AnnouncedParameters:
    """Collects the announcements of the participants in a recording."""

    def __init__(self) -> None:
        self._participants: dict[str, list[Participant]] = {}
        self._members: dict[str, Mapping[str, str]] = {}

    def add(self, topic: Topic, data: bytes) -> None:
        """Process a message of ``participants`` or ``plant/run_status``; ignore all others."""
        try:
            if topic is RUN_STATUS:
                status = decode_run_status(data)
                self._members[status.run] = status.participants
                return
            announcement = decode_announcement(data)
        except ValueError:
            return
        self._participants.setdefault(announcement.run, []).append(announcement.participant)

    def _of_run(self, run: str) -> dict[str, Mapping[str, object]]:
        """Return the parameters by role, only of participants that the run status lists."""
        values: dict[str, Mapping[str, object]] = {}
        for each in self._participants.get(run, ()):
            if each.role in NODES and each.parameters and self._took_part(each, run):
                values.setdefault(each.role, each.parameters)
        return values

    def _took_part(self, participant: Participant, run: str) -> bool:
        member = self._members.get(run, {}).get(participant.role, '')
        return participant.parameters_sha256[:12] in member

    def participant(self, run: str, role: str) -> Participant | None:
        """Return who took a role in the run with this name; None if nobody was announced."""
        announced = (each for each in self._participants.get(run, ()) if each.role == role)
        return next((each for each in announced if self._took_part(each, run)), None)

    def foreign(self, run: str) -> dict[str, Participant]:
        """Return the participants that are nodes of other packages, by role."""
        found = ((role, self.participant(run, role)) for role in ROLES)
        return {role: each for role, each in found if each and each.is_foreign}

    def has_parameters(self, run: str) -> bool:
        """Return whether all parameters needed to replay the run with this name were announced."""
        return self._of_run(run).keys() >= SIMULATED

    def is_of_another_scenario(self, run: str) -> bool:
        """Return whether the scenario of a run differs from that of the first announced run."""
        first = next(iter(self._participants), run)
        return bool(self._scenario(run) != self._scenario(first))

    def _scenario(self, run: str) -> object:
        return self._of_run(run).get(PLANT, {}).get('scenario')

    def of(
        self, run: str, attached: ParameterSet, files: Mapping[str, AttachedFile]
    ) -> ParameterSet:
        """Return the parameters of a run by its name in ``plant/run``.

        The attached parameters apply where no value was announced; the attached files include the
        map if it was a file.
        """
        parameters = ParameterSet()
        parameters.update(attached)
        for role, values in self._of_run(run).items():
            for name, value in values.items():
                if name in PATHS and name != 'map':
                    continue  # a path is useless on another machine
                if name == 'map' and isinstance(value, str) and is_file_name(value):
                    value = _attached_map(files, values.get(MAP_HASH)) or value
                try:
                    parameters.set(role, name, value)
                except ParameterError:
                    continue  # a foreign controller has its own parameters
        return parameters


def _attached_map(files: Mapping[str, AttachedFile], sha256: object) -> str | None:
    for name in MAPS:
        if name in files and hashlib.sha256(files[name].data).hexdigest() == sha256:
            return name
    return None
