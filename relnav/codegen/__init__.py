"""Compilation: kernels of plain loops, and straight-line machine code from branch-free mathematics."""
