"""The compiler: from syntax trees to the text of a Python module. `driver.py` sequences the phases."""
