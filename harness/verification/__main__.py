"""Write the page with its pictures, and the page on streets."""

from harness.verification import streets
from harness.verification.page import write

if __name__ == "__main__":
    write()
    streets.write()
