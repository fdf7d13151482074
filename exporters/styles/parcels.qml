<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: mean height of the crop, from the shortest parcel (pale) to the tallest (dark green). -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips|Rendering">
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="173,221,142,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="coalesce(ramp_color(create_ramp(map(0, '#f7fcb9', 0.5, '#78c679', 1, '#004529')), if(maximum(&quot;mean_height_m&quot;) &gt; minimum(&quot;mean_height_m&quot;), (&quot;mean_height_m&quot; - minimum(&quot;mean_height_m&quot;)) / (maximum(&quot;mean_height_m&quot;) - minimum(&quot;mean_height_m&quot;)), 0.5)), '#d9d9d9')"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="&quot;id&quot; || coalesce('\n' || format_number(100 * &quot;mean_height_m&quot;, 1) || ' cm', '')" fontSize="9" fontSizeUnit="Point" fontFamily="Sans" textColor="40,40,40,255" isExpression="1">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <layerOpacity>0.85</layerOpacity>
 <mapTip enabled="1">&lt;b&gt;parcel [% "id" %]&lt;/b&gt;: [% coalesce(format_number(100 * "mean_height_m", max(0, 1 - floor(log10(200 * "height_sigma_m")))) || ' ± ' || format_number(round(200 * "height_sigma_m", 1 - floor(log10(200 * "height_sigma_m"))), max(0, 1 - floor(log10(200 * "height_sigma_m")))) || ' cm (95 %)', format_number(100 * "mean_height_m", 1) || ' cm', '?') %], [% coalesce(format_number("volume_m3", max(0, 1 - floor(log10(2 * "volume_sigma_m3")))) || ' ± ' || format_number(round(2 * "volume_sigma_m3", 1 - floor(log10(2 * "volume_sigma_m3"))), max(0, 1 - floor(log10(2 * "volume_sigma_m3")))) || ' m³ (95 %)', format_number("volume_m3", 2) || ' m³', '?') %]&lt;br&gt;cover [% coalesce(format_number(100 * "cover", 1), '?') %] %, [% format_number("points_m2", 0) %] points/m²[% if("lodging", ', may be lodged', '') %]</mapTip>
</qgis>
