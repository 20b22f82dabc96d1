"""`python -m relnav`: the same command line as `relnav`."""

from relnav.cli import main

if __name__ == "__main__":
    main()
