"""Arms of real servos (HerkuleX DRS) beside a simulated platform, and an emulator of them."""
