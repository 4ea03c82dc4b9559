"""Somebody must know: what is wrong goes out by webhook, MQTT and e-mail, once, until it is over.

every message ──► [causes] ──► [book] ──► outbox on disk ──► a thread a channel ──► outside
                  what is wrong  what is told  survives          retries with back-off
                  and what ended               restarts

The pipeline never waits for the outside: a message costs a look, a notice a small file.
"""
