"""Write the page with its pictures, and the pages on streets and on controllers."""

from harness.verification import controllers, streets
from harness.verification.page import write

if __name__ == "__main__":
    write()
    streets.write()
    controllers.write()
