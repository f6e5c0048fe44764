mod accuracy;
mod baselines;
mod envelopes;
mod shapes;
mod signs;
mod smoothness;
