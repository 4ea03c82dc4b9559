"""OPC UA: a subscription to the variables of one server."""
