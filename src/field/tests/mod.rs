mod accuracy;
mod baselines;
mod certificate;
mod envelopes;
mod shapes;
mod signs;
mod smoothness;
