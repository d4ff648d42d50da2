"""Everything that is only about Zalud et al. 2015: printed numbers, tables, statements."""
