"""What travels: one module per message. Fixed structs on the hot path, msgpack elsewhere.

Every message has a schema version, a size limit and a decoder that refuses anything else with
`MessageError`; nothing that arrives can make a service fail.
"""
