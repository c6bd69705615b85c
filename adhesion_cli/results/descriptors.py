"""The messages of a result file: what `schemas/adhesion/*.proto` say, ready to write.

`adhesion.binpb` is compiled from those files by `schemas/generate.py`.
"""

from functools import cache
from importlib.resources import files

from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass


@cache
def _files() -> dict[str, FileDescriptorProto]:
    packed = files(__package__).joinpath("adhesion.binpb").read_bytes()
    return {file.name: file for file in FileDescriptorSet.FromString(packed).file}


@cache
def schema(name: str) -> bytes:
    """FileDescriptorSet of a message, as "AxleInput", and its imports, as MCAP schemas carry it."""
    file = _files()[f"adhesion/{name}.proto"]
    imports = [_files()[path] for path in file.dependency]  # which import nothing
    packed: bytes = FileDescriptorSet(file=[*imports, file]).SerializeToString()
    return packed


@cache
def numbers(name: str) -> dict[str, int]:
    """Field numbers of one message by field name."""
    descriptor: DescriptorProto = _files()[f"adhesion/{name}.proto"].message_type[0]
    return {field.name: field.number for field in descriptor.field}


@cache
def message(name: str) -> type[Message]:
    """Protobuf class of one message, for the few that are not packed by columns."""
    pool = DescriptorPool()
    for file in _files().values():
        pool.Add(file)  # listed in order of import
    message_class: type[Message] = GetMessageClass(pool.FindMessageTypeByName(f"adhesion.{name}"))
    return message_class
