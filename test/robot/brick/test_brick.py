"""The brick: the inputs as the tasks see them, and the outputs of a tick."""

from ballbot_ros.robot.brick.brick import Brick, DeviceInputs, DeviceOutputs, Tone

STILL = DeviceInputs(gyro=(600, 601), revolutions=(10, -20))


def tick(brick, inputs=STILL, task=lambda: None, systick_ms=0):
    return brick.tick(systick_ms, inputs, task)


def test_inputs_are_latched_before_the_tasks_and_outputs_taken_after():
    brick, seen = Brick(), []

    def task():
        seen.append((brick.gyro, brick.revolutions, brick.battery_mv))
        brick.duty = (7, -8)

    outputs = tick(brick, DeviceInputs((598, 602), (1, 2), 40, 8003, (0, 0)), task)
    assert seen == [((598, 602), (1, 2), 8003)]
    assert outputs.duty == (7, -8)


def test_the_sonar_reads_the_distance_at_the_previous_request():
    brick, read = Brick(), []
    for sample in (40, 41, None, 42, 255):
        tick(brick, STILL._replace(sonar_cm=sample), lambda: read.append(brick.read_sonar()))
    assert read == [0, 40, 41, 41, 42]


def test_of_the_samples_between_two_requests_only_the_newest_is_seen():
    brick, read = Brick(), []
    for sample, asks in ((10, True), (20, False), (30, False), (40, True), (50, True)):
        tick(
            brick,
            STILL._replace(sonar_cm=sample),
            lambda asks=asks: read.append(brick.read_sonar() if asks else None),
        )
    assert read == [0, None, None, 10, 40]


def test_display_and_log_show_the_last_readings():
    brick = Brick()
    assert brick.sonar_cm == -1

    def task():
        brick.log(0, 0, 0, 0)
        brick.read_sonar()

    logged = [tick(brick, STILL._replace(sonar_cm=40), task).log[0].sonar_cm for _ in range(3)]
    assert logged == [-1, 0, 40]


def test_the_battery_keeps_its_newest_sample():
    brick = Brick()
    tick(brick, DeviceInputs((600, 600), (0, 0), 40, 8003))
    tick(brick)
    assert brick.battery_mv == 8003
    tick(brick, DeviceInputs((600, 600), (0, 0), 41, 7990))
    assert brick.battery_mv == 7990


def test_motors_keep_their_duty_until_it_is_set_again():
    brick = Brick()

    def task():
        brick.duty = (30, 40)

    tick(brick, task=task)
    assert tick(brick).duty == (30, 40)


def test_the_system_time_is_a_32_bit_number():
    brick = Brick()
    tick(brick, systick_ms=2**32 + 5)
    assert brick.systick_ms == 5


def test_a_log_record_holds_the_devices_of_its_tick():
    brick = Brick()
    inputs = DeviceInputs((598, 602), (12, -34), 200, 8003)
    tick(brick, inputs, brick.read_sonar)
    tick(brick, inputs, brick.read_sonar)
    [record] = tick(brick, inputs, lambda: brick.log(0, 0, 5, -6), systick_ms=1234).log
    assert (record.time_ms, record.battery_mv, record.sonar_cm) == (1234, 8003, 200)
    assert (record.rev_a, record.rev_b, record.rev_c) == (0, 12, -34)
    assert (record.adc1, record.adc2, record.adc3, record.adc4) == (5, -6, 0, 0)


def test_outputs_are_those_of_one_tick():
    brick = Brick()

    def task():
        brick.sound_tone(440, 500, 70)
        brick.show_status('NAME')
        brick.log(0, 0, 0, 0)

    first = tick(brick, task=task)
    assert first.tones == [Tone(440, 500, 70)]
    assert len(first.pages) == len(first.log) == 1
    assert tick(brick) == DeviceOutputs()
    assert len(first.pages) == 1


def test_the_display_shows_ports_and_connection():
    brick = Brick()
    inputs = DeviceInputs((598, 602), (12, -34), 200, 8003, (0, 0))
    [page] = tick(brick, inputs, lambda: brick.show_status('BALL'), systick_ms=5000).pages
    assert [line.split() for line in page.split('\n')] == [
        ['BALL'],
        ['TIME:5'],
        ['BATT:80'],
        ['REV:', '0', '12'],
        ['-34'],
        ['ADC:', '598', '602'],
        ['0', '0'],
        ['BT/DST:', '1', '-1'],
    ]
