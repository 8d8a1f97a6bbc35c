"""The status page."""

from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.brick import status_page

INT32 = st.integers(-(2**31), 2**31 - 1)


def page(**changes):
    values = {
        'systick_ms': 12_999,
        'battery_mv': 8003,
        'revolutions': (0, -123, 456),
        'adc': (600, 598, 0, 0),
        'bluetooth_connected': True,
        'sonar_cm': 255,
    }
    return status_page('NXT BALLBOT', **{**values, **changes}).split('\n')


def test_the_page_of_a_known_state():
    assert page() == [
        'NXT BALLBOT     ',
        'TIME:12         ',
        'BATT:80         ',
        'REV: 0  -123    ',
        '     456        ',
        'ADC: 600  598   ',
        '     0    0     ',
        'BT/DST: 1  255  ',
    ]


def test_a_missing_connection_and_sonar_are_shown():
    assert page(bluetooth_connected=False, sonar_cm=-1)[7] == 'BT/DST: 0   -1  '


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 65535),
    st.tuples(INT32, INT32, INT32),
    st.tuples(*[st.integers(0, 1023)] * 4),
    st.integers(-1, 255),
    st.text(max_size=40).filter(lambda name: len(name.splitlines()) < 2),
)
def test_a_page_has_eight_lines_of_sixteen_characters(
    systick_ms, battery_mv, revolutions, adc, sonar_cm, name
):
    lines = status_page(
        name,
        systick_ms=systick_ms,
        battery_mv=battery_mv,
        revolutions=revolutions,
        adc=adc,
        bluetooth_connected=False,
        sonar_cm=sonar_cm,
    ).split('\n')
    assert [len(line) for line in lines] == [16] * 8


@given(st.integers(-99_999, 999_999), st.integers(-99_999, 999_999))
def test_the_angles_of_a_long_drive_are_legible(rev_b, rev_c):
    lines = page(revolutions=(0, rev_b, rev_c))
    assert lines[3][:6] == 'REV: 0'
    assert int(lines[3][6:]) == rev_b
    assert int(lines[4]) == rev_c
