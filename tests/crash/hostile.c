int test_hostile(void); int test_hostile(void) { return 0; }
