"""A job with the files that it needs, for workers that may be other machines."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from ballbot_ros.controllers.loading import find_code, is_file_reference
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    PLANT,
    ControllerParameters,
    ParameterSet,
)
from ballbot_ros.studies.errors import StudyError
from ballbot_ros.studies.job import Job
from ballbot_ros.world.library import map_path, read_map_file


class PackedFile(NamedTuple):
    """A file: its name without folders, and its content."""

    name: str
    data: bytes

    def unpack(self, folder: Path) -> Path:
        """Write the file below a folder, unless it is there; StudyError if it can't be written."""
        path = folder / hashlib.sha256(self.data).hexdigest() / self.name
        if path.exists():
            return path
        # Other threads may do the same, and read the file as soon as it has its name.
        temporary = path.with_name(f'.{uuid4().hex}')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(self.data)
            temporary.replace(path)
        except OSError as error:
            raise StudyError(f'{path}: {error.strerror}') from None
        return path


@dataclass(frozen=True)
class PackedJob:
    """A job that any machine can do.

    Attributes
    ----------
    job : Job
        Its folder and the paths of its files are meaningless elsewhere.
    map : PackedFile or None
        The map. Shipped ones are packed, too: the hash of the package's code leaves them out.
    controller : PackedFile or None
        The file of a controller.
    controller_sha256 : str
        Hash of the controller's code; '' for the document's program.
    """

    job: Job
    map: PackedFile | None
    controller: PackedFile | None
    controller_sha256: str

    @classmethod
    def of(cls, job: Job) -> PackedJob:
        """Read the files of a job; BallbotError if one can't be read."""
        packed_map = controller = None
        sha256 = ''
        if name := job.spec.plant.map:
            packed_map = PackedFile(map_path(name).name, read_map_file(name))
        reference = _controller_of(job)
        if reference not in DOCUMENTS_PROGRAM:
            code = find_code(reference)
            sha256 = code.source.sha256
            if is_file_reference(reference):
                controller = PackedFile(code.path.name, code.source.data)
        return cls(replace(job, folder=Path()), packed_map, controller, sha256)

    def unpack(self, folder: Path) -> Job:
        """Write the files below a folder, and return the job with their paths.

        Raises
        ------
        BallbotError
            If a file can't be written, or an installed controller has other code here.
        """
        parameters = ParameterSet()
        parameters.update(self.job.spec.parameters)
        if self.map:
            parameters.set(PLANT, 'map', str(self.map.unpack(folder)))
        reference = _controller_of(self.job)
        if self.controller:
            class_name = reference.rpartition(':')[2]
            reference = f'{self.controller.unpack(folder)}:{class_name}'
            parameters.set(CONTROLLER, 'implementation', reference)
        if self.controller_sha256 and find_code(reference).source.sha256 != self.controller_sha256:
            raise StudyError(f'its controller {reference} has other code')
        return replace(self.job, spec=replace(self.job.spec, parameters=parameters))


def _controller_of(job: Job) -> str:
    return job.spec.parameters.of(ControllerParameters).implementation
