"""Compile the .proto files into the descriptors that the package carries and writes into results.

    python schemas/generate.py

Needs grpcio-tools (the `dev` extra). Run it after every change of a .proto file; a test compares.
"""

import sys
import tempfile
from importlib.resources import files
from pathlib import Path

SCHEMAS = Path(__file__).parent
TARGET = SCHEMAS.parent / "adhesion_cli" / "results" / "adhesion.binpb"


def compiled() -> bytes:
    """All messages and what they import, as one serialised FileDescriptorSet."""
    from grpc_tools import protoc

    protos = sorted(p.relative_to(SCHEMAS).as_posix() for p in SCHEMAS.glob("adhesion/*.proto"))
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "adhesion.binpb"
        options = [
            f"--proto_path={SCHEMAS}",
            f"--proto_path={files('grpc_tools') / '_proto'}",
            "--include_imports",
            f"--descriptor_set_out={target}",
        ]
        if protoc.main(["protoc", *options, *protos]) != 0:
            sys.exit("protoc failed")
        return target.read_bytes()


if __name__ == "__main__":
    TARGET.write_bytes(compiled())
