"""What the package offers, one file a family of functions: `import vispeg` names them, the commands call them."""
