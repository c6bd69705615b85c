"""`python -m adhesion_cli` and the `adhesion` command."""

from .cli.app import main

if __name__ == "__main__":
    main()
