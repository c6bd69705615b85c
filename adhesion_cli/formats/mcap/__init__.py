"""MCAP logs, from bytes to columns.

- `records`, `blocks`: the bytes of a file, checked, and the messages in them.
- `definitions`, `walk`: one walk over a file, its damage and its losses.
- `fields`, `stamps`, `columns`: numbers and times in messages, alone and many at once.
- `protobuf`, `ros2`, `json_messages`: a decoder for each encoding.
- `series`, `collect`, `reader`: what each topic carries, its columns, and the log as a source.
"""
