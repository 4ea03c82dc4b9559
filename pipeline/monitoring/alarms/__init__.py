"""Alarms by webhook, MQTT and e-mail: raised once, reminded of, and ended.

every message ──► [conditions] ──► [alarm log] ──► outbox ──► a thread a channel ──► receiver
                  what is wrong    what is sent    survives   retries with back-off
                  and what ended                   restarts
                                               [heartbeat] ──► receiver that misses it

The pipeline never waits for a receiver: a message costs a look, an alarm a small file.
"""
