"""jsonschema without its optional parser of addresses, whose grammar takes a second to load.

To be imported before nbformat, which loads jsonschema; nothing here checks an address.
"""

import sys

sys.modules.setdefault("rfc3987_syntax", None)
