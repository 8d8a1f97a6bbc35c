"""What the command ``ballbot run --viewer`` tells its page about its runs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ballbot_ros.analysis.metrics import Judgement
from ballbot_ros.engine.scenario.scenario import Expectation


@dataclass(frozen=True)
class SessionResult:
    """Result of a run.

    Attributes
    ----------
    verdict : str
        One of :class:`~ballbot_ros.analysis.metrics.Verdict`.
    reason : str
        Why the run did not pass; otherwise ''.
    recording : str
        Path of the recording; '' if there is none.
    judgements : tuple of Judgement
        The expectations with their measured values; empty if the run was not judged.
    """

    verdict: str
    reason: str = ''
    recording: str = ''
    judgements: tuple[Judgement, ...] = ()


@dataclass(frozen=True)
class Session:
    """The run that the command has started last; `result` is None until it has ended."""

    scenario: str
    result: SessionResult | None = None


def encode_session(scenario: str, result: Mapping[str, object] | None = None) -> str:
    """Return a session as JSON; `result` is the object that ``run --json`` prints."""
    return json.dumps({'scenario': scenario, 'result': result}, allow_nan=False)


def decode_session(text: str) -> Session:
    """Decode a session; ValueError if the text is none."""
    try:
        content = json.loads(text)
        result = content['result']
        return Session(str(content['scenario']), None if result is None else _result(result))
    except (AttributeError, KeyError, RecursionError, TypeError) as error:
        raise ValueError(f'not a session: {error!r}') from None


def _result(content: Mapping[str, Any]) -> SessionResult:
    return SessionResult(
        verdict=str(content['outcome']),
        reason=str(content['reason']),
        recording=str(content.get('recording') or ''),
        judgements=tuple(
            _judgement(each)
            for each in content.get('expectations', ())
            if each['holds'] is not None
        ),
    )


def _judgement(content: Mapping[str, Any]) -> Judgement:
    """Return what :meth:`Judgement.as_json` has written, where a missing number is None."""
    end, value = content['to'], content['value']
    expectation = Expectation(
        content['metric'],
        start=content['from'],
        end=math.inf if end is None else end,
        minimum=content['min'],
        maximum=content['max'],
    )
    return Judgement(expectation, math.nan if value is None else value)
