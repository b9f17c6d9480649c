"""``python -m specklegen``: the command line."""

from specklegen.cli.commands import main

if __name__ == "__main__":
    main()
