"""The serial link between host and board: ports, packets and time-outs (docs/reference/protocol.md)."""
