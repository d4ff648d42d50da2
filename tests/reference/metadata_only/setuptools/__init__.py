"""Stands in for setuptools while `make nist` downloads archives: it runs nothing of them."""
