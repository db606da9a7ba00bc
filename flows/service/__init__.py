"""What keeps an archive served by itself: server and worker, forms and schedules, the inbox."""
