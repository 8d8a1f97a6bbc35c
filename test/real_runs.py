"""Recordings of a real robot, made from the log packets of a simulated run."""

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.parameters import LogFormat
from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.recording.csv_log import write_csv_log
from ballbot_ros.recording.messages.brick_messages import BrickMessages
from ballbot_ros.recording.messages.topics import BLUETOOTH_TX, GAMEPAD_JOY
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.bluetooth import PACKET_SIZE, LogPacket

WALL_NS = 1_796_070_113_778_000_000
"""Wall time of the first packet."""


def logged_packets(recording):
    """Return the log packets in a recording."""
    topic = BLUETOOTH_TX.resolved()
    with RecordingReader(recording) as reader:
        return [LogPacket.decode(raw.data[-PACKET_SIZE:]) for raw in reader.raw_messages([topic])]


def write_csv(path, packets):
    """Write packets as the document's logger does; return the path."""
    write_csv_log(path, packets)
    return path


def write_real(
    path, packets, *, sticks=(), attachments=(), log_content='pitch', delay_ns=7_000_000
):
    """Write what a link to a brick records of packets; return the path.

    `sticks` are pairs of a time since the first packet [s] and what was sent.
    """
    with RecordingWriter(path) as writer:
        topics, delay = {}, [0]

        def make(topic):
            def send(stamp_ns, data):
                if topic not in topics:
                    topics[topic] = writer.add_topic(topic.resolved(), topic.type_name)
                recorded = topics[topic]
                writer.write(recorded, stamp_ns + delay[0], data, recorded.count + 1, stamp_ns)

            return send

        for name, data in attachments:
            writer.add_attachment(name, 'application/yaml', data)
        messages = BrickMessages(make, LogFormat(log_content=log_content))
        messages.begin(WALL_NS, '1 00:16:53:00:00:01')
        delay[0] = delay_ns
        waiting = [(WALL_NS + round(time * 1e9), each) for time, each in sticks]
        for each in packets:
            stamp_ns = WALL_NS + (each.time_ms - packets[0].time_ms) * MILLISECOND_NS
            while waiting and waiting[0][0] <= stamp_ns:
                messages.sticks(*waiting.pop(0), 'gamepad')
            messages.packet(stamp_ns, each)
    return path


def recorded_sticks(recording):
    """Return the sticks in the recording of a simulated run, as :func:`write_real` takes them."""
    run = read_run(recording)
    series, first = run.series[GAMEPAD_JOY], logged_packets(recording)[0].time_ms * 1e-3
    start = run.start_ns * 1e-9
    rows = zip(series.time.tolist(), series.values.tolist(), strict=True)
    return [
        (time + start - first, (round(-100 * forward), round(100 * rightward)))
        for time, (forward, rightward) in rows
        if time + start >= first
    ]
