//! One phantom head in many forms: each format, coordinate system, order and encoding in which other tools write it gives the same
//! surface, or the same volume, within the form's precision. One line a form.

#[cfg(test)]
mod dicom;
#[cfg(test)]
mod surfaces;
#[cfg(test)]
mod volumes;
