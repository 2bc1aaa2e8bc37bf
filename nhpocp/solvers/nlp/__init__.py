"""The task as a nonlinear programme: direct shooting, solved by IPOPT or fatrop.

Begin with `multiple_shooting`, the solver; `shooting_run` is one start and `ending` how it ended, in words;
`staged_transcription` the variables, rows and derivatives, `interval` one stage of them; `ipopt` and `fatrop` know
their optimizer's options and words, `optimizer` what both are asked.
"""
