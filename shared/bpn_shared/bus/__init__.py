"""The only place that knows Zenoh: sessions, newest-only streams, requests, weights, liveliness.

Zenoh's traps that shaped it: shared memory is off (payloads of a frozen receiver were corrupted), multicast
is off, every service is a client of one router, no work is done in a receive callback beyond one copy,
queries are dropped as soon as they are answered, sessions are always closed.
"""
