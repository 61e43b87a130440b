"""The page of `vispeg check`: recordings before anybody fits to them."""
