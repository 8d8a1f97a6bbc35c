"""Access to the page, and permission to steer."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ballbot_ros.viewer.address import AccessPolicy

LOCAL = AccessPolicy('127.0.0.1', 'robot', 'secret')
EVERYWHERE = AccessPolicy('0.0.0.0', 'Robot', 'secret')
EVERYWHERE_6 = AccessPolicy('::', 'robot', 'secret')
NAMED = AccessPolicy('lab.example', 'robot', 'secret')


@pytest.mark.parametrize(
    ('policy', 'at', 'host'),
    [
        (LOCAL, ('127.0.0.1', 8080), '127.0.0.1:8080'),
        (LOCAL, ('127.0.0.1', 8080), 'localhost:8080'),
        (LOCAL, ('127.0.0.1', 8080), 'LocalHost:8080'),
        (LOCAL, ('127.0.0.1', 80), '127.0.0.1'),
        (LOCAL, ('127.0.0.1', 80), '127.0.0.1:80'),
        (AccessPolicy('::1', 'robot', 'secret'), ('::1', 8080), '[::1]:8080'),
        (EVERYWHERE, ('192.0.2.7', 8080), '192.0.2.7:8080'),
        (EVERYWHERE, ('192.0.2.7', 8080), 'robot:8080'),
        (EVERYWHERE, ('127.0.0.1', 8080), 'localhost:8080'),
        (EVERYWHERE_6, ('2001:db8::7', 8080), '[2001:db8::7]:8080'),
        (NAMED, ('192.0.2.7', 8080), 'lab.example:8080'),
        (NAMED, ('192.0.2.7', 8080), '192.0.2.7:8080'),
    ],
)
def test_requests_under_the_names_of_this_machine_are_answered(policy, at, host):
    assert policy.allows([host], [], at)
    assert policy.allows([host], [f'http://{host}'], at)
    assert not policy.allows([host], ['null'], at)
    assert not policy.allows([host], [f'https://{host}'], at)
    assert not policy.allows([host], ['https://evil.example'], at)
    assert not policy.allows([host], [f'http://{host}', 'https://evil.example'], at)


REFUSED = [
    (LOCAL, []),
    (LOCAL, ['127.0.0.1:8080', 'evil.example:8080']),
    (LOCAL, ['127.0.0.1:8081']),
    (LOCAL, ['127.0.0.1']),
    (LOCAL, ['127.0.0.1:80']),
    (LOCAL, ['evil.example:8080']),
    (LOCAL, ['127.0.0.1.evil.example:8080']),
    (LOCAL, ['evil.example@127.0.0.1:8080']),
    (LOCAL, ['192.0.2.7:8080']),
    (LOCAL, ['robot:8080']),
    (EVERYWHERE, ['evil.example:8080']),
    (EVERYWHERE, ['192.0.2.8:8080']),
    (NAMED, ['evil.lab.example:8080']),
]


def test_requests_under_other_names_are_refused():
    for policy, hosts in REFUSED:
        assert not policy.allows(hosts, [], ('127.0.0.1', 8080)), (policy, hosts)


def test_a_page_at_another_port_or_name_of_this_machine_is_foreign():
    for origin in ('http://127.0.0.1:9000', 'http://localhost:8080', 'http://127.0.0.1'):
        assert not LOCAL.allows(['127.0.0.1:8080'], [origin], ('127.0.0.1', 8080))


@given(st.text())
@example('127.0.0.1:8080 ')
@example('[::1]')
def test_no_other_name_is_accepted(host):
    served = {'127.0.0.1:8080', 'localhost:8080', '[::1]:8080'}
    assert LOCAL.allows([host], [], ('127.0.0.1', 8080)) == (host.lower() in served)


@given(st.text(st.characters(codec=None)))
@example('')
@example('secre')
@example('secrets')
@example('Secret')
@example('secret&token=')
@example('\udcff')
def test_only_the_token_steers(text):
    steers = text.rpartition('token=')[2] == 'secret'
    for target in (f'/?token={text}', f'/?websocket=ws://127.0.0.1:8080/?token={text}'):
        assert LOCAL.may_steer(target) == steers


def test_the_token_steers():
    assert LOCAL.may_steer('/?token=secret')
    for target in ('', '/', '/?token', '/?token=', '/?secret', '/?websocket=ws://evil.example/'):
        assert not LOCAL.may_steer(target)


@pytest.mark.parametrize(
    ('policy', 'address'),
    [
        (LOCAL, 'http://127.0.0.1:8080/?token=secret'),
        (EVERYWHERE, 'http://Robot:8080/?token=secret'),
        (EVERYWHERE_6, 'http://robot:8080/?token=secret'),
        (NAMED, 'http://lab.example:8080/?token=secret'),
    ],
)
def test_the_address_has_the_token(policy, address):
    assert policy.address(8080) == address


def test_a_page_connects_to_its_own_address():
    for target in ('/', '/?token=secret'):
        assert LOCAL.is_page(target)
    for target in (
        '/?token=wrong',
        '/?websocket=ws://evil.example/',
        '/?websocket=ws://evil.example/?token=secret',
        '/?playbackPath=https://evil.example/run.viser',
    ):
        assert not LOCAL.is_page(target)
