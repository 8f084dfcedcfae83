"""Arrays in, arrays out: no records, no files. The paper's letters are fixed in each module's docstring."""
