"""A study: its configuration, its tables of samples, and the template of a new one."""
