"""The Python interface, one file per family of functions; `vispeg` exports them, and the commands call them."""
