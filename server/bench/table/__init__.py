"""Parts of ``dronerf bench table1``: flights, test views, fields, figures, and its report."""
