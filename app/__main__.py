"""`python -m furrowmap`: the command line."""

from furrowmap.cli.main import main

if __name__ == "__main__":
    main()
