"""The task as a nonlinear programme: direct shooting, solved by IPOPT or fatrop.

Begin with `multiple_shooting`, the solver; `shooting_run` is one start and `ending` how it ended, in words; `guesses`
is what it starts from, `first_plan` another solver's plan, which it makes cheaper or hands back;
`staged_transcription` the variables, rows and derivatives, `interval` one stage of them; `ipopt` and `fatrop` know
their optimizer's options and words, `optimizer` what both are asked.
"""
