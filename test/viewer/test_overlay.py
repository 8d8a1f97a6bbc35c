"""What the overlay shows, and the requests of its pages."""

import asyncio
import json

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.viewer.overlay import (
    Banner,
    BannerKind,
    Button,
    ChooseRate,
    Hold,
    Mark,
    MarkKind,
    Overlay,
    OverlayState,
    Press,
    Seek,
    Timeline,
    parse_request,
)


def text_of(content):
    return content if isinstance(content, str) else json.dumps(content)


class StubConnection:
    """Stores what is sent, and has messages of a page, which stays until the end of `stay`."""

    def __init__(self, *messages, stay=None):
        self.sent, self.messages, self.stay = [], messages, stay

    async def send(self, text):
        self.sent.append(json.loads(text))

    async def __aiter__(self):
        for text in self.messages:
            yield text
        if self.stay:
            await self.stay()


@pytest.mark.parametrize(
    ('content', 'request_'),
    [
        ({'press': 'pause'}, Press('pause')),
        ({'rate': '0.5×'}, ChooseRate('0.5×')),
        ({'seek': 3}, Seek(3.0)),
        ({'seek': 3.25}, Seek(3.25)),
        ({'forward': -1, 'rightward': 0.5}, Hold(3, -1.0, 0.5, 7.5)),
        ({'forward': 1.01, 'rightward': 0.0}, None),
        ({'forward': 0.0, 'rightward': -2}, None),
        ({'forward': 0.5}, None),
        ({'seek': True}, None),
        ({'seek': 'now'}, None),
        ('{"seek": 1e999}', None),
        ('{"seek": NaN}', None),
        ('{"seek": 1' + 400 * '0' + '}', None),
        ({'press': 1}, None),
        ({'press': None}, None),
        ({}, None),
        ([], None),
        ('', None),
        ('{', None),
        ('[' * 100_000, None),
    ],
)
def test_requests_and_nonsense(content, request_):
    assert parse_request(text_of(content), 3, 7.5) == request_


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)
REQUESTS = st.dictionaries(st.sampled_from(['press', 'rate', 'seek', 'forward', 'rightward']), JSON)


@given(REQUESTS | JSON)
def test_no_message_raises(content):
    request = parse_request(json.dumps(content), 3, 7.5)
    if isinstance(request, Hold):
        assert max(abs(request.forward), abs(request.rightward)) <= 1.0


def test_only_changes_are_sent():
    overlay = Overlay()
    state = OverlayState(
        banner=Banner('paused', BannerKind.BAD, ('a', 'b')),
        buttons=(Button('pause', 'Pause', ' '),),
        timeline=Timeline(8.0, (Mark(1.0, MarkKind.PUSH, 'push 1 N'),)),
    )

    async def show():
        for _ in range(3):
            await asyncio.sleep(0.01)
            overlay.show(state)
            overlay.move_playhead(1.23456)
        await asyncio.sleep(0.01)

    connection = StubConnection(stay=show)
    asyncio.run(overlay.serve(connection, may_steer=False))
    _, first, *changes = connection.sent
    assert first['state']['banner'] is None
    content, time = sorted(changes, key=str)
    assert content['state']['banner'] == {
        'text': 'paused', 'kind': 'bad', 'details': ['a', 'b'], 'link': '', 'link_text': ''
    }  # fmt: skip
    assert content['state']['timeline']['marks'][0]['kind'] == 'push'
    assert time == {'time': 1.235}


def test_requests_come_in_their_order_without_nonsense():
    overlay = Overlay()
    messages = [text_of({'press': 'a'}), '?', text_of({'seek': 2}), b'{}']
    asyncio.run(overlay.serve(StubConnection(*messages), may_steer=True))
    asyncio.run(overlay.serve(StubConnection(text_of({'press': 'b'})), may_steer=False))
    assert overlay.take() == [Press('a'), Seek(2.0)]
    assert overlay.take() == []
