"""The live view: one WebSocket per browser tab, topics by subscription, and who is alive.

Nothing here may slow the loop: what is watched is published beside it, at most 30 times a second and only
while somebody looks; a callback of the network leaves what came in a bounded place and returns; every client
takes from there at its own pace and keeps no queue of its own.
"""
