"""Pictures, report and animation, drawn from stored solutions alone; no system is known by name here.

Begin with `panels`, which says what pictures of a solution show, or with what draws it: `figures` (SVG and PNG),
`report` (one page of HTML), `animation`; `style` holds colours and sizes, `labels` symbols and units.
"""
