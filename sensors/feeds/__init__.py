"""Live instruments → AccelerationBlocks and ScadaSamples: one file a protocol.

    MQTT, SeedLink, OPC UA, UDP, a CSV file that grows
        │ ChannelSamples: some channels, some samples, the instrument's own time
    [assembler]  channels put together by time, gaps kept, blocks of a second
        │ AccelerationBlock, as of any other source

Only this package of `sensors` opens sockets. `protocol.py` defines what a feed is, `address.py` how
one is named, `open_feed.py` which there are.
"""
