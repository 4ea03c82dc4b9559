"""A coverage-guided fuzzer (atheris, where it is installed) on the decoder.

python -m tests.benchmarks._fuzz_decoder [-max_total_time=SECONDS] [-runs=N]

The first byte chooses the stream, the rest is the payload. Anything but a message or a CodecError
is a finding, and libFuzzer writes the bytes that led to it to a file.
"""

import sys

import atheris

with atheris.instrument_imports(include=["pipeline.transport", "pipeline.messages", "sensors"]):
    from pipeline.streams import STREAMS
    from pipeline.transport.codec import decode, encode
    from pipeline.transport.errors import CodecError


def one_input(data: bytes) -> None:
    """Decode; what is let in can also be written again."""
    if not data:
        return
    stream = STREAMS[data[0] % len(STREAMS)]
    try:
        message = decode(stream.message, data[1:])
    except CodecError:
        return
    encode(message)


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
