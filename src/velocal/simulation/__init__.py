"""The simulated world: files as a scanner and a surveyor would hand them over.

Only tests and the comparison with truth may read what this package knows of the truth.
"""
