"""The sweeps of `runge_kutta` and `shot` as C, compiled once and kept in the user's cache.

Nothing here changes an answer: `kernels` says when a kernel does the work and when CasADi does. `*_source` write the C
text with `c_functions`, `*_kernel` call what was built, `kernel_build`, `kernel_folder` and `kernel_cache` build, keep
and distrust files.
"""
