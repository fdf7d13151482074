"""Cloud-optimised point clouds (COPC 1.0, https://copc.io): LAZ 1.4 whose chunks are the nodes of an octree.

``points`` turns batches into ``records``; ``cube`` names the cells of space; ``octree`` draws each point's level and
sorts records into nodes, with a file for those that memory does not hold; ``chunk`` compresses a node, layer by layer
(``layers``, on ``arithmetic``); ``file`` writes header, chunks and hierarchy; ``writer`` is the interface. Reasons and
measurements: docs/decisions/copc-writer.md.
"""
