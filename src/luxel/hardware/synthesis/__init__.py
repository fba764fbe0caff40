"""The circuit of the hardware interpolator through open tools: Yosys, nextpnr for an ECP5, OpenSTA for standard cells.

`tools` finds and runs them, `ecp5` and `liberty` are the two ways, `designs` names what goes through them, `report` puts it in a table.
"""
