"""`python -m benchmarks NAME`, the same as `unwrinkle bench NAME`."""

import sys

from unwrinkle.cli import main

if __name__ == "__main__":
    sys.argv.insert(1, "bench")
    main()
