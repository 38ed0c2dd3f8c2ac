"""Run a command while no other process runs it: ``alone.py LOCK COMMAND...``.

The lock is the kernel's, on a file, and goes with the process that holds it, however that ends.
Plain Python: it runs before there is an environment.
"""

import fcntl
import os
import sys


def main(path, command):
    """Wait for the lock, saying so, and become the command, which keeps it."""
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        sys.exit(f"error: {path}: {error.strerror}: it must be a file that can be written")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        print(f"waiting: another make is at work here (it holds {path})", file=sys.stderr)
        fcntl.flock(lock, fcntl.LOCK_EX)
    os.set_inheritable(lock, True)
    os.execvp(command[0], command)


if __name__ == "__main__":
    if len(sys.argv) < 3 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2:])
