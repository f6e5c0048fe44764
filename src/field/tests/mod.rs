mod accuracy;
mod envelopes;
mod shapes;
mod signs;
mod smoothness;
