"""Cloud-optimised point clouds (COPC 1.0, https://copc.io): LAZ 1.4 whose chunks are the nodes of an octree.

``points`` turns batches into ``records``; ``cube`` names the cells of space and ``levels`` draws each point's level;
``octree`` sorts records into nodes, with ``spool`` for those that memory does not hold; ``chunk`` compresses a node,
layer by layer (``layers``, ``time_layer``, ``colour_layer``, on ``arithmetic`` and ``integers``); ``file`` writes
header, chunks and hierarchy; ``writer`` is the interface. Reasons and measurements: docs/development/files.md.
"""
