"""Write the page and its pictures."""

from harness.verification.page import write

if __name__ == "__main__":
    write()
