"""The paper's figures and tables, each made by one command.

A target says which runs it needs (`plan`, pure), what is measured with them (`measure`), and how the result is
drawn and tabulated (`draw`, `table`, pure). The campaign runs what is not there yet.
"""
