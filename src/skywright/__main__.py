"""`python -m skywright` is the same as `skywright`."""

from skywright.cli import main

if __name__ == "__main__":
    main()
