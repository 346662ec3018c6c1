"""The interactive twin: a view-model of one robot in hand, and one front end that shows it in browsers."""
