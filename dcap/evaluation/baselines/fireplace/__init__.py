"""FirePlace*: placement by constraints between planar surfaces, solved without physics.

The source [H25] takes a scene, an object and a sentence; a multimodal model writes *constraint outlines*, resolves each
outline's anchor thing and the *interaction surfaces* (planar surfaces, extracted from the meshes) of both sides,
solves a library of simple binary constraints for the object's pose, and prunes the feasible placements by common sense
on renders. Options are always shown to the model in small batches (*batched visual selection*). From it are these five
steps, the planar surfaces, the batches, that constraints are binary, and contact, parallel and non-overhang among them.
Its code is not public, so ours are: all formulas (`problem.py`), the thresholds of the surfaces (`planar.py`), the
way the constraints are solved, batch sizes and votes (`solve.py`), and all texts of questions. Where
a surface that the source would take from the mesh is missing because a thing is round or soft, a side of its box stands
in, so that the method is not left without an answer.

[H25] Huang, Bao, Truong, Zhou, Schmid, Guibas, Fathi: FirePlace, geometric refinements of LLM common sense reasoning
for 3D object placement, CVPR 2025, arXiv 2503.04919.
"""
