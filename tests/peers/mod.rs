//! A node's services, actions and parameters as peers of both wire forms use them: Cyclone DDS and Fast DDS.

mod bad_input;
mod cli;
mod echo;
mod goals;
mod long_replies;
mod mixed;
