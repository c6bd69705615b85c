"""MCAP logs, from bytes to columns.

- `records`: the bytes of a file, checked, and the messages in them.
- `walk`: one walk over a file, what it defines, its damage and its losses.
- `fields`, `columns`: numbers and times in messages, alone and many at once.
- `protobuf`, `ros2`, `json_messages`: a decoder for each encoding.
- `series`, `reader`: what each topic carries, its columns, and the log as a source.
"""
