"""u-blox UBX logs: messages found in a stream of bytes, and one receiver's positions of them."""
