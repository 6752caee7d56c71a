"""What tests share: machines, daemons, brokers, recordings, and how to wait for them."""
