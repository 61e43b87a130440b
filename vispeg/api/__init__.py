"""The Python interface, one file per family of functions; `import vispeg` exports them and the commands call them."""
