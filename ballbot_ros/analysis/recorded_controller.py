"""The controller of a recorded run that is not the document's: its identity and its code."""

from __future__ import annotations

import hashlib
import io
import re
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from ballbot_ros.controllers.loading import (
    GROUP,
    MAIN,
    ControllerCode,
    LoadedController,
    find_code,
    is_installed,
    load,
    public_reference,
    resolve_reference,
)
from ballbot_ros.errors import ControllerError, one_line, printable
from ballbot_ros.files import OUR_PACKAGE, write_temporary
from ballbot_ros.lockstep.participants import SOURCE_HASH, Participant
from ballbot_ros.parameters import CONTROLLER, DOCUMENTS_PROGRAM
from ballbot_ros.parameters.yaml_document import parse_data, yaml_text
from ballbot_ros.recording.reader import AttachedFile

SHOWN_HASH = 12
_HASH = re.compile('[0-9a-f]{64}')
NOT_PORTABLE = 'not portable: its duties may differ on another machine'


@dataclass(frozen=True)
class ControllerIdentity:
    """What identifies a controller, as attached to a recording.

    Attributes
    ----------
    reference : str
        The parameter `implementation`; of a file only its name.
    class_path : str
        Module and class, ``package.module:Class``; '' for a file.
    sha256 : str
        Hash of its code, the attached file.
    package : str
        Name and version of the package that it was installed from; '' for none.
    portable : bool
        Whether its duties are the same on every machine.
    """

    reference: str = ''
    class_path: str = ''
    sha256: str = ''
    package: str = ''
    portable: bool = True

    def __str__(self) -> str:
        package = f' of {self.package}' if self.package else ''
        return f'{printable(self.reference + package)} (sha256 {self.sha256[:SHOWN_HASH]})'

    @property
    def class_name(self) -> str:
        """Name of the class; '' if only the name of an installed controller is known."""
        return (self.class_path or self.reference).rpartition(':')[2]

    @property
    def is_of_main(self) -> bool:
        """Whether its class was one of a notebook or main program, which is not attached whole."""
        return self.reference.startswith(f'{MAIN}:')

    @property
    def description(self) -> str:
        """The identity, and whether the controller is portable."""
        return str(self) if self.portable else f'{self}, {NOT_PORTABLE}'

    @classmethod
    def of(cls, loaded: LoadedController) -> ControllerIdentity:
        """Return the identity of a controller."""
        code = loaded.code
        return cls(
            public_reference(code.reference),
            f'{code.module}:{code.class_name}' if code.module else '',
            code.source.sha256,
            code.owner,
            loaded.cls.portable,
        )


SUCCESSOR = 'successor'
"""Name of the files of a controller that takes over during a run."""


def encode_controller(loaded: LoadedController, name: str = CONTROLLER) -> dict[str, bytes]:
    """Return the attachments of a controller, by file name."""
    identity, source = asdict(ControllerIdentity.of(loaded)), loaded.code.source
    return {
        f'{name}.yaml': yaml_text(identity).encode(),
        f'{name}{source.suffix}': source.data,
    }


def decode_controller(
    files: Mapping[str, AttachedFile], name: str = CONTROLLER
) -> ControllerIdentity | None:
    """Return the attached identity of a controller; None if there is none that can be read."""
    info = files.get(f'{name}.yaml')
    content = parse_data(info.data) if info else None
    kinds = {each.name: type(each.default) for each in fields(ControllerIdentity)}
    values: dict[str, Any] = (
        {name: content.get(name) for name in kinds} if isinstance(content, dict) else {}
    )
    if values and all(isinstance(values[name], kind) for name, kind in kinds.items()):
        identity = ControllerIdentity(**values)
        return identity if _HASH.fullmatch(identity.sha256) else None
    return None


def identity_of(
    reference: str, announced: Mapping[str, object], attached: ControllerIdentity | None
) -> ControllerIdentity | None:
    """Return what identifies the controller of a run; None if nothing does.

    `reference` is its parameter `implementation`. What it announced is empty if unknown.
    """
    sha256 = str(announced.get(SOURCE_HASH, ''))
    if not _HASH.fullmatch(sha256):
        sha256 = ''
    if attached and _name(attached.reference) == _name(reference):
        return replace(attached, sha256=sha256) if sha256 else attached
    return ControllerIdentity(reference, sha256=sha256) if sha256 else None


def _name(reference: str) -> str:
    """Return a reference without folders: nodes may have been started in different ones."""
    return reference.rpartition('/')[2]


def find_recorded(
    identity: ControllerIdentity, recording: Path, requested: str | None
) -> LoadedController:
    """Load the user's own copy of a recorded controller, whose code must be the recorded one.

    Of a class of a notebook or main program, only the text of its cell was recorded, without what
    it uses. So its copy can't be compared, except by its duties.

    `requested` says where the copy is. None stands for the installed controller that the recording
    names: it can't choose any other code, because it could also name the right hash. It raises
    ControllerError if there is none; the message says how to get it.
    """
    try:
        code = _find_copy(identity, requested)
    except ControllerError as error:
        problem = str(error)
    else:
        if code.source.sha256 == identity.sha256 or identity.is_of_main:
            return load(code)
        problem = f'{code.shown} has changed (sha256 {code.source.sha256[:SHOWN_HASH]})'
    if identity.is_of_main:
        raise ControllerError(
            f'{recording}: its controller is {identity}, a class of a notebook or main program: '
            f'write it, with all that it uses, to a file and give it {_HOW_TO_GIVE} '
            f'FILE.py:{identity.class_name}' + (f' ({problem})' if requested else '')
        )
    remedy = f'give your copy of that code {_HOW_TO_GIVE} FILE.py:Class or package.module:Class'
    if ':' not in identity.reference:
        remedy = f'install that code of {printable(identity.package) or "its package"}'
    raise ControllerError(
        f'{recording}: its controller is {identity}, but {problem}; {remedy}, or run the attached '
        'code by --trust-attached-code'
    )


_HOW_TO_GIVE = 'as --controller of replay, or --code of branch and view,'


def _find_copy(identity: ControllerIdentity, requested: str | None) -> ControllerCode:
    if requested is None:
        if not is_installed(identity.reference):
            raise ControllerError(f'that is not installed as a controller (entry point of {GROUP})')
        return find_code(identity.reference)
    code = find_code(resolve_reference(requested, Path.cwd()))
    if code.class_name != identity.class_name:
        raise ControllerError(f'{code.class_name} is another class of {code.shown}')
    return code


def load_attached(
    identity: ControllerIdentity,
    recording: Path,
    files: Mapping[str, AttachedFile],
    scratch: Path,
    role: str = CONTROLLER,
) -> LoadedController:
    """Execute the code attached to a recording, which the user has said to trust.

    It raises ControllerError if none is attached, or that of another run.
    """
    for name in (f'{role}.py', f'{role}.zip'):
        if name in files and hashlib.sha256(files[name].data).hexdigest() == identity.sha256:
            break
    else:
        raise ControllerError(f'{recording}: the code of {identity} is not attached')
    if name.endswith('.zip'):
        folder = scratch / role
        try:
            with zipfile.ZipFile(io.BytesIO(files[name].data)) as archive:
                archive.extractall(folder)
        except (zipfile.BadZipFile, OSError, RuntimeError, ValueError) as error:
            raise ControllerError(f'{recording}: {name}: {one_line(error)}') from None
        sys.path.insert(0, str(folder))
        code = find_code(identity.class_path)
        if code.source.sha256 != identity.sha256:  # an imported package has the same name
            raise ControllerError(f'{recording}: {code.shown} hides the attached code')
        return load(code)
    file = scratch / name
    write_temporary(file, files[name].data)
    return load(find_code(f'{file}:{identity.class_name}'))


PYTHON = 'python'


class Successor(NamedTuple):
    """The controller that takes over during a run, and when [s]."""

    controller: str
    at_s: float

    def __str__(self) -> str:
        return f'{self.controller} takes over at {self.at_s:.3f} s'


@dataclass(frozen=True)
class ReplayedController:
    """The control program that stands in for a recorded one.

    Both are values of the parameter `implementation`; a foreign recorded controller has its
    announced name. The reason says why they differ; empty if they don't, or if one was requested.
    A controller that is not portable may compute other duties on another machine.
    """

    recorded: str
    replayed: str
    reason: str = ''
    is_portable: bool = True
    successor: Successor | None = None


def choose_controller(
    participant: Participant | None,
    attached: str,
    requested: str | None,
    missing_tool: Callable[[str], str],
) -> ReplayedController:
    """Return the program for a replay of the document's: the requested, or else the recorded one.

    Python replaces an implementation that can't run here, since the two are proven bit-identical.
    `participant` is the run's controller as announced, if known; `attached` is the parameter
    `implementation` in the attached parameters. `missing_tool` returns the tool that an
    implementation lacks on this machine; '' for none.
    """
    parameters: dict[str, object] = dict(participant.parameters) if participant else {}
    recorded = str(parameters.get('implementation', attached))
    reason = ''
    if participant and participant.is_foreign:
        recorded = participant.implementation
        reason = (
            f'its controller {recorded!r} is not part of {OUR_PACKAGE}, whose own controller '
            'replays it'
        )
    elif recorded not in DOCUMENTS_PROGRAM:
        reason = f'this version does not know its controller {recorded!r}; {PYTHON} replays it'
    elif missing := missing_tool(recorded):
        reason = (
            f'its controller {recorded!r} cannot run here: {missing}; {PYTHON}, which is proven '
            'equal, replays it'
        )
    if requested:
        return ReplayedController(recorded, requested)
    return ReplayedController(recorded, PYTHON if reason else recorded, reason)
