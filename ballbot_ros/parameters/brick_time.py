"""Parameters of the brick's time: its kernel, what its tasks cost, and its link to the motors."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters.parameter import quantity, setting

COUNT = (0, 10**7)
MICROSECONDS = (0.0, 1e5)


@dataclass(frozen=True, kw_only=True)
class KernelChoice:
    """Whether the brick's tasks take time."""

    kernel: bool = setting(
        False, "true: the brick's tasks take time; false: none, as in the document", 'facts'
    )


@dataclass(frozen=True, kw_only=True)
class LinkParameters:
    """The link between the brick's processor and that of the motors and analog ports."""

    link: bool = setting(
        False, 'true: gyro and battery readings and duties pass the link; false: no delay', 'facts'
    )
    link_phase: int = quantity(
        -1,
        '1',
        (-1, 1),
        'the link sends at even (0) or odd (1) milliseconds; -1: drawn from the seed',
        'facts',
    )
    converter_period: float = quantity(
        3.1, 'ms', (0.001, 20.0), 'period of the analog converter', 'facts'
    )


@dataclass(frozen=True, kw_only=True)
class TaskCosts:
    """What the jobs of the brick cost.

    The instructions are those that qemu counts on each path of the generated C; ``ballbot codegen
    --check`` writes them to a parameter file.
    """

    processor_clock: float = quantity(48.055, 'MHz', (1.0, 1000.0), 'clock of the brick', 'facts')
    cycles_per_instruction: float = quantity(
        2.0, '1', (1.0, 10.0), 'mean of the processor; up to twice that from flash', 'facts'
    )
    init_instructions: int = quantity(321, '1', COUNT, 'task_init', 'qemu')
    calibration_instructions: int = quantity(408, '1', COUNT, 'task_ts1 in calibration', 'qemu')
    control_instructions: int = quantity(5734, '1', COUNT, 'task_ts1 in control', 'qemu')
    stop_instructions: int = quantity(30, '1', COUNT, 'task_ts1 with motors stopped', 'qemu')
    log_instructions: int = quantity(623, '1', COUNT, 'added to task_ts1 by a log packet', 'qemu')
    obstacle_instructions: int = quantity(29, '1', COUNT, 'task_ts2', 'qemu')
    state_instructions: int = quantity(432, '1', COUNT, 'task_ts3', 'qemu')
    tone_instructions: int = quantity(13, '1', COUNT, 'added to task_ts3 by a tone', 'qemu')
    display_instructions: int = quantity(6, '1', COUNT, 'task_lcd', 'qemu')
    times_of: str = setting('', 'hash of the program whose times these are; empty: not checked')
    tick_time: float = quantity(
        500.0,
        'µs',
        MICROSECONDS,
        "a task of a controller that is not the document's, with its calls",
    )
    bluetooth_time: float = quantity(20.0, 'µs', MICROSECONDS, 'call that sends a packet', 'facts')
    tone_time: float = quantity(1000.0, 'µs', MICROSECONDS, 'call that sounds a tone', 'facts')
    display_time: float = quantity(95.0, 'µs', MICROSECONDS, 'call that draws the page', 'facts')
    sonar_time: float = quantity(
        4200.0, 'µs', MICROSECONDS, 'time for which a reading of the sonar keeps the bus', 'facts'
    )
    bus_cycles: float = quantity(
        200.0, '1', (0.0, 1000.0), "cycles of each of the bus's 38 400 interrupts a second", 'guess'
    )
    interrupt_time: float = quantity(
        10.0, 'µs', (0.0, 900.0), 'the interrupt of each millisecond', 'guess'
    )
    time_variation: float = quantity(
        0.0, '1', (0.0, 1.0), 'largest random addition to the time of a job, as a share'
    )
    link_time: float = quantity(
        5.0, 'µs', (0.0, 900.0), 'from that interrupt until the link takes the duties', 'guess'
    )
    motor_latency: float = quantity(
        230.0, 'µs', (0.0, 1e4), 'from then until a duty acts: 0.23 ms on the wire', 'facts'
    )
    kernel_defect: bool = setting(
        False,
        'true: a task that has preempted another one blocks alarms and link, as in nxtOSEK',
        'facts',
    )
