"""Both ends of every declared span: keys of scenarios and data sheets, and what flows into levels."""
