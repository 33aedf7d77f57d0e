"""From an operational design domain to a campaign of function tests and its dossier."""
