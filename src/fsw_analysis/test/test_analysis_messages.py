"""Messages of a bag that others have made."""

from pathlib import Path

from mcap.writer import Writer

from fsw_analysis.messages import WeldMessages


def test_messages_of_mixed_types_are_decoded_by_their_own_type(
    tmp_path: Path,
) -> None:
    path = tmp_path / "two.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channels = []
        for name, definition in (
            ("std_msgs/msg/Int32", b"int32 data\n"),
            ("std_msgs/msg/Float32", b"float32 data\n"),
        ):
            schema = writer.register_schema(name, "ros2msg", definition)
            channels.append(writer.register_channel("/a", "cdr", schema))
        for time_ns, channel in enumerate((*channels, channels[0]), 1):
            writer.add_message(
                channel, time_ns, b"\0\1\0\0" + time_ns.to_bytes(4, "little"), time_ns
            )
        writer.finish()
    messages = WeldMessages(path)
    assert [message.data for *_, message in messages.decoded("/a")] == [1, 3]
    assert messages.problems == [
        "/a: 1 messages of another type than std_msgs/msg/Int32 are left out"
    ]
