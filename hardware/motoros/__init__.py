"""MotoROS' protocol: messages, connections, and the channels that use them."""
