"""The schema of everything that is sent and recorded: pilewatch.proto and the code made from it.

After a change of pilewatch.proto, from the project's folder:

    uvx --from 'grpcio-tools==1.74.0' python-grpc-tools-protoc \\
        --proto_path=. --python_out=. --pyi_out=. pipeline/transport/proto/pilewatch.proto

That version writes code for protobuf 6.31 and everything after it up to 7.x; a newer one would
refuse the older runtimes.
"""
