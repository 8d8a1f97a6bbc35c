"""Changed copies of recordings."""

from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder
from ballbot_ros.recording.writer import RecordingWriter


def copy_recording(
    path,
    *sources,
    wanted=lambda topic: True,
    types=None,
    edit=lambda raw, number: raw.data,
    attach=lambda data: data,
    first=(),
    extra=None,
):
    """Write a copy of recordings, one after the other; return its path.

    It has the `wanted` topics, in other `types` if these are given. `edit` returns the data of a
    message in the source of a number, from 1, and `attach` that of an attachment; None drops it.
    The messages `first`, as topic, stamp and data, come before those of a source; the messages
    `extra`, as message and stamp by topic, are the last.
    """
    with RecordingWriter(path) as writer:
        topics = {}

        def topic(name, kind):
            if name not in topics:
                topics[name] = writer.add_topic(name, kind)
            return topics[name]

        for number, source in enumerate(sources, 1):
            with RecordingReader(source) as reader:
                for name, file in reader.attachments().items():
                    if (data := attach(file.data)) is not None:
                        writer.add_attachment(name, file.media_type, data)
                kinds = {name: each.type_name for name, each in reader.topics().items()}
                kinds |= types or {}
                for name, stamp_ns, data in first:
                    writer.write(topic(name, kinds[name]), stamp_ns, data, 1)
                for raw in filter(lambda raw: wanted(raw.topic), reader.raw_messages()):
                    copied = topic(raw.topic, kinds[raw.topic])
                    if (data := edit(raw, number)) is not None:
                        writer.write(copied, raw.stamp_ns, data, raw.sequence)
        for name, (message, stamp_ns) in (extra or {}).items():
            kind = message.__msgtype__
            writer.write(topic(name, kind), stamp_ns, encoder(kind)(message), 1)
    return path
