"""How messages travel: written by the codec, carried by a bus, taken out of an inbox.

codec         messages ↔ bytes, by the schema in proto/
bus           the protocols: Bus, Subscription; Inbox
awaited_bus   a bus whose session may open later
zenoh_bus     everything else
"""
