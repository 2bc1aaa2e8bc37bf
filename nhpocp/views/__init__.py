"""Pictures, report and animation, drawn from stored solutions alone; no system is known by name here.

Begin with `figures` (SVG and PNG), `report` (one page of HTML) or `animation`; `style` holds colours and sizes.
"""
