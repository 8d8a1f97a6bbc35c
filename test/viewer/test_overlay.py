"""What the overlay shows, and the requests of its pages."""

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
    PageMessage,
    Press,
    Seek,
    Timeline,
    parse_request,
)


def message(content):
    text = content if isinstance(content, str) else json.dumps(content)
    return PageMessage(3, text, 7.5)


class StubLink:
    """Stores what is published, and hands out messages."""

    def __init__(self, *messages):
        self.sent, self.messages = [], list(messages)

    def publish(self, topic, value):
        self.sent.append((topic, value))

    def take(self):
        return self.messages


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
    assert parse_request(message(content)) == request_


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)
REQUESTS = st.dictionaries(st.sampled_from(['press', 'rate', 'seek', 'forward', 'rightward']), JSON)


@given(REQUESTS | JSON)
def test_no_message_raises(content):
    request = parse_request(message(json.dumps(content)))
    if isinstance(request, Hold):
        assert max(abs(request.forward), abs(request.rightward)) <= 1.0


def test_only_changes_are_sent():
    link = StubLink()
    overlay = Overlay(link)
    state = OverlayState(
        banner=Banner('paused', BannerKind.BAD, ('a', 'b')),
        buttons=(Button('pause', 'Pause', ' '),),
        timeline=Timeline(8.0, (Mark(1.0, MarkKind.PUSH, 'push 1 N'),)),
    )
    for _ in range(3):
        overlay.show(state)
        overlay.move_playhead(1.23456)
    _, (topic, content), time = link.sent
    assert topic == 'state'
    assert json.loads(json.dumps(content))['banner'] == {
        'text': 'paused', 'kind': 'bad', 'details': ['a', 'b'], 'link': '', 'link_text': ''
    }  # fmt: skip
    assert content['timeline']['marks'][0]['kind'] == 'push'
    assert time == ('time', 1.235)


def test_requests_come_in_their_order_without_nonsense():
    link = StubLink(message({'press': 'a'}), message('?'), message({'seek': 2}))
    assert Overlay(link).take() == [Press('a'), Seek(2.0)]
