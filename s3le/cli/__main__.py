"""`python -m s3le.cli` is `s3le`."""

from s3le.cli.main import run

if __name__ == "__main__":
    run()
